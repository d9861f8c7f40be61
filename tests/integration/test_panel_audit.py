"""The auditor's pages over a real log: found, certified, computed again; scripts in stored text stay text."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from station.adapters.store.reader import LogReader
from station.adapters.store.search import Query
from station.config.settings import load_settings
from station.web import accounts, certificate
from station.web.accounts import Account, Role
from station.web.app import create_app
from station.web.panel import Panel
from station.web.questions import query_of
from station.web.runs import Order
from station.wiring.jobs import load_job
from tests.fakes import fixture_run

HTML = {"accept": "text/html"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("log")
    fixture_run.run(made, ["SN0001", "SN0002"], faults=("SN0002/stuck-axis:value=2",), lot="<script>alert(1)</script>")
    return made


@pytest.fixture(scope="module")
def client(folder: Path) -> Iterator[TestClient]:
    people = {"ada": Account("ada", Role.AUDITOR, accounts.hash_password("correct horse"))}
    accounts.save(folder / "accounts.json", people)
    job, _ = load_job("six-point")
    order = Order(folder / "station.db", "six-point", simulate=True)
    panel = Panel(load_settings(), job.recipe, order, folder / "accounts.json")
    made = TestClient(create_app(panel))
    made.post("/login", data={"name": "ada", "password": "correct horse"})
    made.headers["csrf"] = next(iter(panel.sessions._open.values())).csrf
    yield made
    made.close()


def test_containment_is_one_question(client: TestClient) -> None:
    asked = {"recipe_name": "six-point", "nest": "A", "since": "2020-01-01", "until": "2099-01-01", "as": "text"}
    assert client.get("/audit", params=asked).text == "SN0001\n"
    assert client.get("/audit", params=asked | {"nest": ""}).text == "SN0001\nSN0002\n"
    assert client.get("/audit", params=asked | {"outcome": "fail", "nest": ""}).text == "SN0002\n"
    assert client.get("/audit", params=asked | {"firmware": "1.0.0"}).text == "SN0001\n"
    assert client.get("/audit", params=asked | {"firmware": "9.9"}).text == ""
    assert client.get("/audit", params={"since": "yesterday-ish"}).status_code == 400


def test_a_page_of_attempts_and_a_life(client: TestClient) -> None:
    page = client.get("/audit", params={"serial": "SN*"}, headers=HTML).text
    assert page.count("/audit/unit?serial=SN000") == 2
    life = client.get("/audit/unit", params={"serial": "SN0001"}, headers=HTML).text
    assert "2101:01" in life, "objects written"
    assert "gain x" in life
    assert client.get("/audit/unit", params={"serial": "SN9999"}, headers=HTML).status_code == 400


def test_stored_text_stays_text(client: TestClient) -> None:
    for at in ("/audit", "/audit/unit?serial=SN0001", "/audit/unit?serial=<script>alert(1)</script>"):
        assert "<script>alert" not in client.get(at, headers=HTML).text


def test_a_certificate_holds_what_an_auditor_asks_for(client: TestClient, folder: Path) -> None:
    with LogReader(folder / "station.db") as log:
        attempt = log.attempts(Query(serial="SN0001"))[0]
        made = certificate.build(log, attempt)
        head = log.head()
    page = client.get("/audit/certificate", params={"serial": "SN0001", "attempt": attempt.attempt}, headers=HTML).text
    values = next(s for s in made.sections if s.title.startswith("Calibration"))
    assert [row[0] for row in values.rows[:4]] == ["offset x", "offset y", "offset z", "gain x"]
    assert all(row[3] != "–" for row in values.rows)
    for wanted in ("guard-band", attempt.recipe_hash, attempt.config_hash, f"{head.number}:{head.hash}", "due for"):
        assert wanted in page
    paper = client.get("/audit/certificate.pdf", params={"serial": "SN0001", "attempt": attempt.attempt})
    assert paper.headers["content-type"] == "application/pdf"
    assert paper.content.startswith(b"%PDF-")
    assert len(paper.content) > 3000


def test_no_calibration_no_certificate(client: TestClient, folder: Path) -> None:
    with LogReader(folder / "station.db") as log:
        attempt = log.attempts(Query(serial="SN0002"))[0]
    answer = client.get("/audit/certificate", params={"serial": "SN0002", "attempt": attempt.attempt})
    assert answer.status_code == 400
    assert "no calibration" in answer.json()["error"]


def test_computed_again_to_the_last_bit(client: TestClient, folder: Path) -> None:
    with LogReader(folder / "station.db") as log:
        attempt = log.attempts(Query(serial="SN0001"))[0]
    data = {"csrf": client.headers["csrf"], "serial": "SN0001", "attempt": attempt.attempt}
    assert "bit for bit" in client.post("/audit/recompute", data=data, headers=HTML).text


def test_a_serial_with_a_star_is_a_beginning() -> None:
    assert query_of({"serial": "SN1*"}) == Query(serial_from="SN1")
    assert query_of({"serial": " SN1 ", "outcome": "pass"}) == Query(serial="SN1", outcome="PASS")
    one_day = query_of({"since": "2026-11-21", "until": "2026-11-21"})
    assert one_day.since_ns is not None
    assert one_day.until_ns is not None
    assert one_day.until_ns - one_day.since_ns == 86400 * 10**9
