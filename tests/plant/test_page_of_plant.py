"""The page over a plant's records: what it shows is what the page at the station shows, and it changes nothing."""

import re
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import pytest
from starlette.applications import Starlette
from starlette.routing import Route
from starlette.testclient import TestClient

from station.cli.app import main
from station.config.settings import load_settings
from station.panel_protocol import accounts
from station.panel_protocol.accounts import Account, Role
from station.ports.log_reader import Query
from station.web.app import create_app
from station.web.panel import Panel
from station.web.run_launcher import LaunchOptions
from station.wiring.jobs import load_job
from tests.fakes.passwords import quick_hash
from tests.fakes.plant import FakePlant, FakeStation, Server

PASSWORD = "correct horse"
#: What a plant's page does beside reading: people come and go, a question is kept beside it, an attempt is refitted.
POSTED = {"/login", "/logout", "/audit/questions", "/audit/recompute"}


@pytest.fixture(scope="module")
def pages(
    server: Server, real_log: FakeStation, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[TestClient, TestClient]]:
    """The page of the station, and that of a plant which has its log; an auditor is logged in at both."""
    place = tmp_path_factory.mktemp("pages")
    plant = FakePlant(server.database(), place / "objects")
    assert plant.take_all(real_log).refusal is None
    file, hashed = place / "accounts.json", quick_hash(PASSWORD)
    accounts.save(file, {role.value: Account(role.value, role, hashed) for role in Role})
    settings, job = load_settings(real_log.folder / "config.yaml"), load_job("six-point")[0]
    made = [
        Panel(settings, job.recipe, LaunchOptions(path, "six-point"), file, address)
        for path, address in ((real_log.path, ""), (place / "plant-page", plant.address))
    ]
    clients = [TestClient(create_app(panel), follow_redirects=False) for panel in made]
    for client in clients:
        assert client.post("/login", data={"name": "auditor", "password": PASSWORD}).status_code == 303
    yield clients[0], clients[1]
    plant.connections.close()


def shown(client: TestClient, path: str) -> str:
    """The words in the middle of a page, without what only who may act sees."""
    answer = client.get(path, headers={"accept": "text/html"})
    assert answer.status_code == 200, answer.text
    main_part = re.search(r"<main.*</main>", answer.text, re.DOTALL)
    assert main_part is not None
    act = r'<form.*?</form>|<script.*?</script>|<section class="[^"]*" aria-label="Signatures">.*?</section>'
    text = re.sub(act, "", main_part[0], flags=re.DOTALL)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", text))


def addresses(real_log: FakeStation) -> list[str]:
    from station.adapters.store.reader import SqliteLogReader

    with SqliteLogReader(real_log.path) as log:
        attempt = log.attempts(Query(serial="SN0001"))[0]
    unit = f"serial={quote(attempt.serial)}&attempt={attempt.attempt}"
    return [f"/audit/unit?{unit}", "/charts", f"/audit/certificate?{unit}"]


def test_units_charts_and_certificates_are_those_of_the_station(
    pages: tuple[TestClient, TestClient], real_log: FakeStation
) -> None:
    own, plants = pages
    for path in addresses(real_log):
        there = shown(plants, path)
        assert len(there) > 200
        assert there == shown(own, path), path
    found = shown(plants, "/audit?serial=SN000*")
    assert "SN0001" in found
    assert "SN0002" in found
    assert plants.get("/audit", params={"serial": "SN0001", "as": "text"}).text == "SN0001\n"


def test_it_reads_and_does_nothing_else(pages: tuple[TestClient, TestClient]) -> None:
    _, plants = pages
    assert isinstance(plants.app, Starlette)
    posted = {r.path for r in plants.app.routes if isinstance(r, Route) and "POST" in (r.methods or ())}
    assert posted == POSTED
    assert (plants.get("/").status_code, plants.get("/").headers["location"]) == (303, "/audit")
    assert "Back to the audit" in plants.get("/nowhere", headers={"accept": "text/html"}).text
    client = TestClient(plants.app, follow_redirects=False)
    client.post("/login", data={"name": "engineer", "password": PASSWORD})
    page = client.get("/audit", headers={"accept": "text/html"}).text
    for absent in ("/diagnose", "/audit/sign", 'href="/"', "/diagnosis"):
        assert absent not in page, absent
    assert plants.post("/command", data={"action": "start"}).status_code == 404


def test_an_operator_has_nothing_to_do_here(pages: tuple[TestClient, TestClient]) -> None:
    client = TestClient(pages[1].app, follow_redirects=False)
    client.post("/login", data={"name": "operator", "password": PASSWORD})
    assert client.get("/audit").status_code == 403


def test_what_a_plants_page_cannot_do_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for words, sentence in (
        (("--simulate",), "The page of a plant only reads"),
        (("--recipe", "six-point"), "The page of a plant only reads"),
        ((), "no server listens there"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(["panel", "--db", f"postgresql:///nowhere?host={tmp_path}", *words])
        assert ended.value.code in (2, 3)
        assert sentence in capsys.readouterr().err
