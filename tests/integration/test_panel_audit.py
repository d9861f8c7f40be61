"""The auditor's pages over a real log: found, certified, computed again; scripts in stored text stay text."""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from station.adapters.store.reader import SqliteLogReader
from station.config.settings import load_settings
from station.panel_protocol import accounts
from station.panel_protocol.accounts import Account, Role
from station.ports.log_reader import Query
from station.reporting.certificate.pdf import pdf
from station.reporting.certificate.writer import CertificateTable
from station.service.certificates import certificate_of
from station.web import language
from station.web.app import create_app
from station.web.panel import Panel
from station.web.query_form import query_of
from station.web.run_launcher import LaunchOptions
from station.wiring.jobs import load_job
from tests.fakes import fixture_run
from tests.fakes.passwords import quick_hash

HTML = {"accept": "text/html"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("log")
    fixture_run.run(made, ["SN0001", "SN0002"], faults=("SN0002/stuck-axis:value=2",), lot="<script>alert(1)</script>")
    return made


@pytest.fixture(scope="module")
def client(folder: Path) -> Iterator[TestClient]:
    people = {"ada": Account("ada", Role.AUDITOR, quick_hash("correct horse"))}
    accounts.save(folder / "accounts.json", people)
    job, _ = load_job("six-point")
    order = LaunchOptions(folder / "station.db", "six-point", simulate=True)
    panel = Panel(load_settings(), job.recipe, order, folder / "accounts.json")
    made = TestClient(create_app(panel))
    made.post("/login", data={"name": "ada", "password": "correct horse"})
    made.headers["csrf"] = next(iter(panel.sessions._open.values())).csrf
    yield made
    made.close()


def test_containment_is_one_question(client: TestClient) -> None:
    requested = {"recipe_name": "six-point", "nest": "A", "since": "2020-01-01", "until": "2099-01-01", "as": "text"}
    assert client.get("/audit", params=requested).text == "SN0001\n"
    assert client.get("/audit", params=requested | {"nest": ""}).text == "SN0001\nSN0002\n"
    assert client.get("/audit", params=requested | {"outcome": "fail", "nest": ""}).text == "SN0002\n"
    assert client.get("/audit", params=requested | {"firmware": "1.0.0"}).text == "SN0001\n"
    assert client.get("/audit", params=requested | {"firmware": "9.9"}).text == ""
    assert client.get("/audit", params={"since": "yesterday-ish"}).status_code == 400
    assert client.get("/audit", params={"recipe_version": "one"}).status_code == 400
    assert client.get("/charts", params={"first": "x"}).status_code == 400


def test_a_question_is_saved_asked_again_and_forgotten(client: TestClient, folder: Path) -> None:
    token = {"csrf": client.headers["csrf"]}
    asked = {"nest": "B", "since": "2020-01-01", "check": "stuck"}
    assert "Nest B, stuck" in client.post("/audit/questions", data=token | asked | {"name": "Nest B, stuck"}).text
    link = re.search(r'href="(/audit\?[^"]*)">Nest B, stuck', client.get("/audit").text)
    assert link is not None
    assert "SN0002" in client.get(link[1].replace("&amp;", "&")).text
    for wrong in ({"name": ""}, {"name": "x" * 81}, {"name": "nothing", "nest": "", "since": "", "check": ""}):
        assert client.post("/audit/questions", data=token | asked | wrong).status_code == 400
    assert client.post("/audit/questions", data=token | asked | {"name": "x", "since": "soon"}).status_code == 400
    (folder / "station.db.questions.json").write_text('{"schema"', "utf-8")
    assert client.get("/audit").status_code == 200, "a torn file is no question"
    client.post("/audit/questions", data=token | asked | {"name": "one"})
    assert "one</a>" not in client.post("/audit/questions", data=token | {"name": "one", "forget": "1"}).text
    assert client.post("/audit/questions", data=token | {"name": "one", "forget": "1"}).status_code == 400


def test_a_page_of_attempts_and_a_life(client: TestClient) -> None:
    page = client.get("/audit", params={"serial": "SN*"}, headers=HTML).text
    assert page.count("/audit/unit?serial=SN000") == 2
    life = client.get("/audit/unit", params={"serial": "SN0001"}, headers=HTML).text
    assert "2101:01" in life, "objects written"
    assert "gain x" in life
    assert client.get("/audit/unit", params={"serial": "SN9999"}, headers=HTML).status_code == 400


def test_a_unit_without_coefficients_shows_what_was_read(client: TestClient) -> None:
    failed = client.get("/audit/unit", params={"serial": "SN0002"}, headers=HTML).text
    assert "Readings by position" in failed
    assert "Residuals by position" not in failed
    passed = client.get("/audit/unit", params={"serial": "SN0001"}, headers=HTML).text
    assert "Residuals by position" in passed


def test_an_address_that_is_none_is_told_in_the_readers_language(client: TestClient) -> None:
    for code, words in (
        ("en", "There is no page /nowhere"),
        ("de", "Die Seite /nowhere gibt es nicht"),
        ("zh", "没有页面"),
    ):
        answer = client.get("/nowhere", params={"language": code}, headers=HTML)
        assert (answer.status_code, words in answer.text) == (404, True)
    client.cookies.delete("station_language")
    assert "takes no such request" in client.get("/command", headers=HTML).text


def test_a_link_keeps_its_language_and_look_over_the_log_in(client: TestClient) -> None:
    stranger = TestClient(client.app, follow_redirects=False)
    first = stranger.get("/audit", params={"language": "zh", "theme": "dark"}, headers=HTML)
    assert (first.status_code, first.headers["location"]) == (303, "/login")
    page = stranger.get("/login", headers=HTML).text
    assert '<html lang="zh" class="dark">' in page


def test_stored_text_stays_text(client: TestClient) -> None:
    for at in ("/audit", "/audit/unit?serial=SN0001", "/audit/unit?serial=<script>alert(1)</script>"):
        assert "<script>alert" not in client.get(at, headers=HTML).text


def test_a_certificate_holds_what_an_auditor_asks_for(client: TestClient, folder: Path) -> None:
    with SqliteLogReader(folder / "station.db") as log:
        attempt = log.attempts(Query(serial="SN0001"))[0]
        made = certificate_of(log, attempt, language.words("en"))
        head = log.head()
    page = client.get("/audit/certificate", params={"serial": "SN0001", "attempt": attempt.attempt}, headers=HTML).text
    values = next(s for s in made.sections if s.title.startswith("Results"))
    assert [row[0] for row in values.rows[:4]] == ["offset x", "offset y", "offset z", "gain x"]
    assert all(row[5] != "–" for row in values.rows)
    assert made.simulated == "SIMULATED" and "SIMULATED" in page
    for wanted in (
        "guarded acceptance",
        attempt.recipe_hash,
        attempt.config_hash,
        f"{head.number}:{head.hash}",
        "traceability to the SI is not claimed",
    ):
        assert wanted in page
    paper = client.get("/audit/certificate.pdf", params={"serial": "SN0001", "attempt": attempt.attempt})
    assert paper.headers["content-type"] == "application/pdf"
    assert paper.content.startswith(b"%PDF-")
    assert len(paper.content) > 3000


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("de", ("Kalibrierschein", "Entscheidungsregel", "Schutzabstand", "Querempfindlichkeit x von y", "IO")),
        ("zh", ("校准证书", "判定规则", "保护带", "横轴 x 来自 y", "合格")),
    ],
)
def test_a_certificate_in_the_readers_language(
    client: TestClient, folder: Path, tmp_path: Path, code: str, words: tuple[str, ...]
) -> None:
    with SqliteLogReader(folder / "station.db") as log:
        attempt = log.attempts(Query(serial="SN0001"))[0]
        english, other = (certificate_of(log, attempt, language.words(one)) for one in ("en", code))
    requested = {"serial": "SN0001", "attempt": attempt.attempt, "language": code}
    page = client.get("/audit/certificate", params=requested, headers=HTML).text
    client.cookies.delete("station_language")
    assert all(word in page for word in words)
    figures = [[row[1:5] for row in s.rows] for made in (english, other) for s in made.sections if len(s.columns) == 7]
    assert figures[: len(figures) // 2] == figures[len(figures) // 2 :], "the figures are the same in every language"
    words_only = [cell for s in other.sections for cell in (s.title, *s.columns, *(row[0] for row in s.rows))]
    assert not [w for w in words_only if w in {c for s in english.sections for c in (s.title, *s.columns)} - _SAME]
    paper = client.get("/audit/certificate.pdf", params=requested)
    client.cookies.delete("station_language")
    assert paper.content.startswith(b"%PDF-")
    assert code != "zh" or b"STSong-Light" in paper.content
    assert b"FiraGO" in paper.content, "the Latin font stands in the file itself"


#: Heads that every language writes alike.
_SAME = {"", "u", "k", "U (95 %)", "Software"}


def test_a_name_in_chinese_stands_on_a_german_certificate(folder: Path) -> None:
    with SqliteLogReader(folder / "station.db") as log:
        made = certificate_of(log, log.attempts(Query(serial="SN0001"))[0], language.words("de"))
    section = CertificateTable("Prüfling", ("", ""), (("Bediener", "王 <b>小</b>\x07"),))
    plain, named = pdf(replace(made, sections=())), pdf(replace(made, sections=(section,)))
    assert len(named) > len(plain)


def test_reasons_and_refusals_come_in_the_readers_language(client: TestClient) -> None:
    page = client.get("/audit/unit", params={"serial": "SN0002", "language": "de"}, headers=HTML).text
    client.cookies.delete("station_language")
    assert "ohne jedes Rauschen" in page
    assert "no noise at all" not in page
    refused = client.get("/audit/unit", params={"serial": "SN9999"}, headers={"accept-language": "zh-CN,zh"})
    assert refused.json()["error"] == "日志中没有被测件 'SN9999'：请搜索。"


def test_no_calibration_no_certificate(client: TestClient, folder: Path) -> None:
    with SqliteLogReader(folder / "station.db") as log:
        attempt = log.attempts(Query(serial="SN0002"))[0]
    answer = client.get("/audit/certificate", params={"serial": "SN0002", "attempt": attempt.attempt})
    assert answer.status_code == 400
    assert "only what passed gets a certificate" in answer.json()["error"]


def test_computed_again_to_the_last_bit(client: TestClient, folder: Path) -> None:
    with SqliteLogReader(folder / "station.db") as log:
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
