"""The engineer picks units on the audit page and reads the report of their diagnosis."""

import re
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from station.config.settings import load_settings
from station.panel_protocol import accounts
from station.panel_protocol.accounts import Account, Role
from station.web import diagnosis_jobs
from station.web.app import create_app
from station.web.panel import Panel
from station.web.run_launcher import LaunchOptions
from station.wiring.jobs import load_job
from tests.fakes import fixture_run
from tests.fakes.passwords import quick_hash


@pytest.mark.timeout(300)
def test_picked_units_are_diagnosed_and_the_report_opens(tmp_path: Path) -> None:
    fixture_run.run(tmp_path, units=2)
    people = {"emil": Account("emil", Role.ENGINEER, quick_hash("correct horse"))}
    accounts.save(tmp_path / "accounts.json", people)
    job, _ = load_job("six-point")
    order = LaunchOptions(tmp_path / "station.db", "six-point", simulate=True)
    panel = Panel(load_settings(), job.recipe, order, tmp_path / "accounts.json")
    with TestClient(create_app(panel), follow_redirects=False) as client:
        client.post("/login", data={"name": "emil", "password": "correct horse"})
        session = panel.sessions.find(client.cookies["station_session"])
        assert session is not None
        token = {"csrf": session.csrf}
        assert client.post("/diagnose", data=token).status_code == 400
        assert client.post("/diagnose", data=token | {"serial": "SN9999"}).status_code == 400
        begun = client.post("/diagnose", data=token | {"serial": ["SN0001", "SN0002"]})
        assert begun.status_code == 303
        at = begun.headers["location"]
        under_way = client.get(at).text
        assert "diagnosed" in under_way
        assert "<script src=" in under_way.partition("<noscript>")[0]
        assert "http-equiv" not in re.sub(r"<noscript>.*?</noscript>", "", under_way), "no page reloads under a reader"
        (child,) = panel.children.values()
        child.wait(280)
        page = client.get(at)
        assert f'src="/diagnosis/report?name={at.partition("name=")[2]}"' in page.text, (
            "the report inside the navigation"
        )
        assert "frame-src 'self'" in page.headers["content-security-policy"]
        alone = client.get(at.replace("/diagnosis", "/diagnosis/report"))
        assert "<svg" in alone.text
        assert "sandbox" in alone.headers["content-security-policy"]
        assert '<html class="auto" ' in alone.text
        dark = client.get(f"{at.replace('/diagnosis', '/diagnosis/report')}&theme=dark")
        assert '<html class="dark" ' in dark.text, "as the page around it"
        assert at.partition("name=")[2] in client.get("/diagnosis").text, "among the earlier ones"
        begun = client.post("/diagnose", data=token | {"nest": "B", "since": "1d"})
        found = diagnosis_jobs.diagnosis_state(panel, begun.headers["location"].partition("name=")[2])
        assert (found.job.units, found.job.question["nest"]) == (1, "B")
        panel.children[found.job.name].kill()
        panel.children[found.job.name].wait()
        assert "6 → 6" not in client.get("/diagnosis/changes").text
        for name in ("../station.db", "0" * 16, ""):
            assert client.get("/diagnosis", params={"name": name}).status_code == 400
