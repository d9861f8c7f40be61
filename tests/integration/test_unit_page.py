"""A unit's pages at every moment of its life: while it runs, and however early it ended."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.testclient import TestClient

from station.config.settings import load_settings
from station.domain.run.progress import Event
from station.panel_protocol import accounts
from station.panel_protocol.accounts import Account, Role
from station.service.stop_request import StopRequest
from station.web.app import create_app
from station.web.panel import Panel
from station.web.run_launcher import LaunchOptions
from station.wiring.bench import Bench
from station.wiring.jobs import load_job
from tests.fakes import fixture_run
from tests.fakes.passwords import quick_hash

HTML = {"accept": "text/html"}
#: Each ends at another step of a run, before and after there is an identity, a reading, a calibration, a value written.
FAULTS = ("SN0002/silent", "SN0003/stuck-axis:value=2", "SN0004/save-fails")


@pytest.fixture
def client(tmp_path: Path) -> Iterator[TestClient]:
    """The page of a log that is not there yet; an auditor has logged in."""
    accounts.save(tmp_path / "accounts.json", {"ada": Account("ada", Role.AUDITOR, quick_hash("correct horse"))})
    order = LaunchOptions(tmp_path / "station.db", "six-point", simulate=True)
    panel = Panel(load_settings(), load_job("six-point")[0].recipe, order, tmp_path / "accounts.json")
    with TestClient(create_app(panel), raise_server_exceptions=False) as made:
        made.post("/login", data={"name": "ada", "password": "correct horse"})
        yield made


def test_every_moment_of_a_units_life_can_be_shown(client: TestClient, tmp_path: Path) -> None:
    names = fixture_run.serials(4)
    seen = set[tuple[str, int]]()

    def look(_event: Event, _stop: StopRequest, _bench: Bench) -> None:
        for path in ("/audit", *(f"/audit/unit?serial={name}" for name in names)):
            answer = client.get(path, headers=HTML)
            assert answer.status_code in (200, 400), f"{path}: {answer.status_code}"
            seen.add((path, answer.status_code))

    ran = fixture_run.run(tmp_path, names, faults=FAULTS, recipe=fixture_run.brief_recipe(tmp_path), hook=look)
    assert {name: str(result.outcome) for name, result in ran.results.items()} == dict(
        zip(names, ("PASS", "ERROR", "FAIL", "FAIL"), strict=True)
    )
    assert {(f"/audit/unit?serial={name}", 200) for name in names} <= seen


def test_what_nobody_foresaw_is_a_sentence_on_a_closed_page(client: TestClient) -> None:
    async def divide(_request: Request) -> Response:
        raise ZeroDivisionError

    assert isinstance(client.app, Starlette)
    client.app.routes.insert(0, Route("/divide", divide))
    answer = client.get("/divide", headers=HTML)
    assert answer.status_code == 500
    assert "This is a bug in the station (ZeroDivisionError)" in answer.text
    assert "default-src 'none'" in answer.headers["content-security-policy"]
