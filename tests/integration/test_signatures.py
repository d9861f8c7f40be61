"""Signatures under attempts, at the command line and at the page; the page's journal sealed into the log."""

import io
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from station.adapters.store.reader import SqliteLogReader
from station.cli.app import run_command
from station.config.settings import load_settings
from station.domain.records.stored_attempt import signatures
from station.panel_protocol import accounts
from station.panel_protocol.accounts import Account, Role
from station.panel_protocol.journal import Journal
from station.panel_protocol.journal_seal import journal_findings
from station.ports.log_reader import Query
from station.service.certificates import certificate_of
from station.web import language
from station.web.app import create_app
from station.web.panel import Panel
from station.web.run_launcher import LaunchOptions
from station.wiring.jobs import load_job
from tests.fakes import fixture_run
from tests.fakes.passwords import quick_hash

PASSWORD = "correct horse"
PEOPLE = {"ada": Role.ENGINEER, "eve": Role.AUDITOR, "bob": Role.OPERATOR}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("log")
    fixture_run.run(made, ["SN0001", "SN0002"], faults=("SN0002/stuck-axis:value=2",))
    stored_hash = quick_hash(PASSWORD)
    people = {name: Account(name, role, stored_hash) for name, role in PEOPLE.items()}
    accounts.save(made / "accounts.json", people)
    return made


@pytest.fixture
def client(folder: Path) -> Iterator[TestClient]:
    job, _ = load_job("six-point")
    order = LaunchOptions(folder / "station.db", "six-point", simulate=True)
    panel = Panel(load_settings(), job.recipe, order, folder / "accounts.json")
    with TestClient(create_app(panel)) as made:
        made.post("/login", data={"name": "eve", "password": PASSWORD})
        made.headers["csrf"] = next(iter(panel.sessions._open.values())).csrf
        yield made


def stored(folder: Path, serial: str) -> dict[str, object]:
    with SqliteLogReader(folder / "station.db") as log:
        return log.attempt(log.attempts(Query(serial=serial))[0])


def sign(folder: Path, monkeypatch: pytest.MonkeyPatch, *words: str, password: str = PASSWORD) -> int:
    monkeypatch.setattr(sys, "stdin", io.StringIO(f"{password}\n"))
    return run_command(["sign", *words, "--db", str(folder / "station.db")])


def test_a_signature_is_bound_to_the_end_of_its_attempt(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sign(folder, monkeypatch, "SN0001", "--by", "ada", "--meaning", "released", "--comment", "lot 7") == 0
    attempt = stored(folder, "SN0001")
    (one,) = signatures(attempt)
    assert {k: one[k] for k in ("by", "role", "meaning", "comment")} == {
        "by": "ada", "role": "engineer", "meaning": "released", "comment": "lot 7"
    }  # fmt: skip
    assert {"number": one["record"], "hash": one["seal"]} == attempt["seal"]
    assert run_command(["audit", "SN0001", "--verify", "--db", str(folder / "station.db")]) == 0
    assert "released by ada (engineer): lot 7" in capsys.readouterr().out
    made = folder / "SN0001.json"
    assert run_command(["certificate", "SN0001", "--json", str(made), "--db", str(folder / "station.db")]) == 0
    written = json.loads(made.read_text())
    assert [(s["by"], s["meaning"]) for s in written["signatures"]] == [("ada", "released")]
    assert written["log"]["witness"] is None
    with SqliteLogReader(folder / "station.db") as log:
        printed = certificate_of(log, log.attempts(Query(serial="SN0001"))[0], language.words("en"))
    rows = [row for section in printed.sections for row in section.rows]
    assert [row[1].partition(",")[0] for row in rows if row[0] == "Released by"] == ["ada (engineer)"]


@pytest.mark.parametrize(
    ("words", "password", "sentence"),
    [
        (("SN0001", "--by", "ada", "--meaning", "reviewed"), "wrong", "not the password of ada"),
        (("SN0001", "--by", "bob", "--meaning", "reviewed"), PASSWORD, "bob is operator: only engineers"),
        (("SN0001", "--by", "zoe", "--meaning", "reviewed"), PASSWORD, "knows nobody called zoe"),
        (("SN0002", "--by", "ada", "--meaning", "released"), PASSWORD, "ended with FAIL: only what passed"),
        (("SN0001", "--by", "ada", "--meaning", "liked"), PASSWORD, "states one of reviewed, released"),
        (("SN9999", "--by", "ada", "--meaning", "reviewed"), PASSWORD, "SN9999"),
    ],
)
def test_who_may_not_sign_so_is_told(
    folder: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], password: str, sentence: str
) -> None:
    before = stored(folder, "SN0001")["events"]
    with pytest.raises(Exception, match=sentence):
        sign(folder, monkeypatch, *words, password=password)
    assert stored(folder, "SN0001")["events"] == before


def post(client: TestClient, folder: Path, **changes: str) -> int:
    form = {
        "csrf": client.headers["csrf"], "serial": "SN0002", "attempt": str(stored(folder, "SN0002")["attempt"]),
        "meaning": "reviewed", "comment": "<b>", "password": PASSWORD,
    }  # fmt: skip
    answer = client.post("/audit/sign", data=form | changes, follow_redirects=False)
    return answer.status_code


def test_the_page_asks_for_the_password_again(client: TestClient, folder: Path) -> None:
    page = client.get("/audit/unit?serial=SN0002").text
    assert 'action="/audit/sign"' in page
    assert 'value="released"' not in page  # it failed
    assert post(client, folder, password="guess") == 400
    assert post(client, folder, csrf="x") == 403
    assert post(client, folder, meaning="released") == 400
    assert signatures(stored(folder, "SN0002")) == []
    assert post(client, folder) == 303
    assert post(client, folder) == 400  # once is enough
    (one,) = signatures(stored(folder, "SN0002"))
    assert (one["by"], one["meaning"], one["comment"]) == ("eve", "reviewed", "<b>")
    assert "&lt;b&gt;" in client.get("/audit/unit?serial=SN0002").text
    deeds = [line["deed"] for line in Journal(folder / "station.db.panel.jsonl").lines()]
    assert deeds.count("sign") == 1
    assert deeds.count("sign-refused") == 1


def test_lines_of_the_journal_cut_or_edited_after_a_seal_are_found(
    folder: Path, client: TestClient, capsys: pytest.CaptureFixture[str]
) -> None:
    post(client, folder)  # whoever signed, the lines until then are sealed
    path = folder / "station.db.panel.jsonl"
    whole = path.read_bytes()
    lines = whole.splitlines(keepends=True)
    made_again = rechained([b'{"deed":"nothing","previous":"x"}\n', *lines[1:]])
    treated = {
        "truncated": [b"".join(lines[:1]), b""],
        "edited": [whole.replace(b"eve", b"bob", 1), b"".join([lines[1], lines[0], *lines[2:]]), made_again],
    }
    for what, contents in treated.items():
        for content in contents:
            path.write_bytes(content)
            with SqliteLogReader(folder / "station.db") as log:
                assert [f.what for f in journal_findings(log, folder / "station.db")[1]] == [what]
    path.unlink()
    assert run_command(["audit", "--verify", "--json", "--db", str(folder / "station.db")]) == 2
    assert json.loads(capsys.readouterr().out)["verify"]["findings"][0]["what"] == "truncated"
    path.write_bytes(whole)
    with SqliteLogReader(folder / "station.db") as log:
        state, found = journal_findings(log, folder / "station.db")
    assert not found
    assert 0 < state.sealed <= state.lines


def rechained(lines: list[bytes]) -> bytes:
    """An edited journal whose hashes were made anew."""
    import hashlib

    previous, out = "0" * 64, []
    for line in lines:
        made = json.dumps({**json.loads(line), "previous": previous}).encode() + b"\n"
        previous = hashlib.sha256(made).hexdigest()
        out.append(made)
    return b"".join(out)
