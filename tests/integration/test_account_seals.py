"""Somebody with the page's files edits who may log in, or cuts lines off the journal: refused, and found."""

import io
import json
import os
import re
import shutil
import stat
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from threading import Timer

import pytest
from starlette.testclient import TestClient

from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.cli.app import run_command
from station.config.settings import load_settings
from station.errors import ConfigError, LogError, StoreFault, UsageError
from station.panel_protocol import accounts
from station.panel_protocol.account_seal import AccountChange
from station.panel_protocol.accounts import Account, Role
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.journal import Journal
from station.panel_protocol.journal_seal import (
    LONGEST_UNSEALED_S,
    MOST_UNSEALED_LINES,
    UnsealedLines,
    journal_findings,
    sealing_journal,
)
from station.panel_protocol.owner_socket import ask
from station.panel_protocol.sealing_socket import hand_over, taking_requests
from station.ports.log_reader import Query
from station.web.app import create_app
from station.web.panel import Panel
from station.web.run_launcher import LaunchOptions
from station.wiring.jobs import load_job
from station.wiring.page_seals import PageSeals
from tests.fakes import fixture_run
from tests.fakes.logs import stranger
from tests.fakes.passwords import quick_hash

PASSWORD, FORGED = "correct horse", "battery staple"


@pytest.fixture(scope="module", autouse=True)
def cheap_passwords() -> Iterator[None]:
    """A thousandth of scrypt's work: what is sealed does not depend on it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(accounts, "_N", 2**7)
        yield


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of one unit, with ada (engineer) and eve (auditor) sealed."""
    folder = tmp_path_factory.mktemp("sealed")
    fixture_run.run(folder, ["SN0001"])
    stored_hash = quick_hash(PASSWORD)
    people = [Account("ada", Role.ENGINEER, stored_hash), Account("eve", Role.AUDITOR, stored_hash)]
    accounts.save(folder / "accounts.json", {p.name: p for p in people})
    assert page_seals(folder).seal()
    return folder


@pytest.fixture(scope="module")
def forged() -> str:
    return quick_hash(FORGED)


@pytest.fixture
def folder(template: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(template, tmp_path / "line"))


@pytest.fixture
def client(folder: Path) -> Iterator[TestClient]:
    job, _ = load_job("six-point")
    order = LaunchOptions(folder / "station.db", "six-point", simulate=True)
    with TestClient(create_app(Panel(load_settings(), job.recipe, order, folder / "accounts.json"))) as made:
        yield made


def page_seals(folder: Path) -> PageSeals:
    database = folder / "station.db"
    return PageSeals(database, load_settings(), folder / "accounts.json", UnsealedLines(database))


def log_in(client: TestClient, name: str, password: str) -> int:
    return client.post("/login", data={"name": name, "password": password}, follow_redirects=False).status_code


def edit(folder: Path, **changed: Account | None) -> None:
    """What a person with the files does."""
    people = accounts.load(folder / "accounts.json") | changed
    accounts.save(folder / "accounts.json", {name: account for name, account in people.items() if account})


def station(folder: Path, monkeypatch: pytest.MonkeyPatch, *words: str, passwords: tuple[str, ...] = ()) -> int:
    monkeypatch.setattr(sys, "stdin", io.StringIO("".join(f"{p}\n" for p in passwords)))
    return run_command([*words, "--db", str(folder / "station.db")])


def verified(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> dict[str, list[str]]:
    capsys.readouterr()
    station(folder, monkeypatch, "audit", "--verify", "--json")
    check = json.loads(capsys.readouterr().out)["verify"]
    return {
        "findings": [f["message"]["id"] for f in check["findings"]],
        "acknowledged": [f["message"]["id"] for a in check["acknowledged"] for f in a["findings"]],
    }


def attacks(forged: str) -> dict[str, dict[str, Account | None]]:
    return {
        "account-changed": {"ada": Account("ada", Role.ENGINEER, forged)},
        "account-added": {"mallory": Account("mallory", Role.ENGINEER, forged)},
        "account-removed": {"eve": None},
    }


def test_an_edited_account_is_refused_found_and_taken_note_of(
    folder: Path,
    client: TestClient,
    forged: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    whole = accounts.load(folder / "accounts.json")
    for what, changed in attacks(forged).items():
        accounts.save(folder / "accounts.json", whole)
        edit(folder, **changed)
        assert verified(folder, monkeypatch, capsys)["findings"] == [what]
    accounts.save(folder / "accounts.json", whole)
    edit(folder, ada=Account("ada", Role.ENGINEER, forged))
    assert log_in(client, "eve", PASSWORD) == 303  # she is as sealed
    answer = client.post("/login", data={"name": "ada", "password": FORGED}, headers={"accept": "application/json"})
    assert answer.status_code == 400
    assert "The account of ada in" in answer.json()["error"]
    with pytest.raises(UsageError, match="not the one that the log has sealed"):
        station(folder, monkeypatch, "sign", "SN0001", "--by", "ada", "--meaning", "released", passwords=(FORGED,))
    assert [line["deed"] for line in Journal(folder / "station.db.panel.jsonl").lines()].count(
        "account-not-sealed"
    ) == 1
    words = ("acknowledge", "--by", "Eve", "--reason", "ada lost her password")
    assert station(folder, monkeypatch, *words) == 0
    assert log_in(client, "ada", FORGED) == 303
    assert verified(folder, monkeypatch, capsys) == {"findings": [], "acknowledged": ["account-changed"]}


def test_an_older_file_put_back_is_refused(folder: Path, client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    older = (folder / "accounts.json").read_bytes()
    words = ("panel", "--remove", "eve", "--by", "ada")
    assert station(folder, monkeypatch, *words, passwords=(PASSWORD,)) == 0
    (folder / "accounts.json").write_bytes(older)
    assert log_in(client, "eve", PASSWORD) == 400
    assert log_in(client, "ada", PASSWORD) == 303


def test_changes_that_an_engineer_vouches_for_are_sealed_alone(
    folder: Path,
    client: TestClient,
    forged: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    edit(folder, eve=Account("eve", Role.ENGINEER, forged))  # slipped in before ada adds somebody
    words = ("panel", "--add", "bob", "--role", "operator", "--by", "ada")
    assert station(folder, monkeypatch, *words, passwords=(PASSWORD, "bob's own one")) == 0
    assert log_in(client, "bob", "bob's own one") == 303
    assert log_in(client, "eve", FORGED) == 400
    own = ("panel", "--add", "bob", "--role", "operator", "--by", "bob")
    assert station(folder, monkeypatch, *own, passwords=("bob's own one", "bob's new one")) == 0
    assert log_in(client, "bob", "bob's new one") == 303
    assert verified(folder, monkeypatch, capsys)["findings"] == ["account-changed"]
    for by, password, sentence in (
        ("bob", "bob's new one", "only an engineer"),
        ("ada", "a guess of it", "not the password of ada"),
        ("eve", FORGED, "not the one that the log has sealed"),
        ("zoe", PASSWORD, "knows nobody called zoe"),
    ):
        with pytest.raises(UsageError, match=sentence):
            station(folder, monkeypatch, "panel", "--remove", "ada", "--by", by, passwords=(password,))


def test_a_change_for_which_nobody_vouches_waits_for_an_engineer(
    folder: Path, client: TestClient, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("panel", "--add", "mallory", "--role", "engineer")
    assert station(folder, monkeypatch, *words, passwords=(FORGED,)) == 0
    assert "No engineer vouches for this change: the page refuses mallory" in capsys.readouterr().err
    assert log_in(client, "mallory", FORGED) == 400


def test_without_an_engineer_in_the_log_changes_are_sealed_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert station(tmp_path, monkeypatch, "panel", "--add", "ada", "--role", "engineer", passwords=(PASSWORD,)) == 0
    assert not (tmp_path / "station.db").exists()  # nothing was ever run: the first seal takes them as they are
    SqliteStore(tmp_path / "station.db").close()
    assert station(tmp_path, monkeypatch, "panel", "--add", "eve", "--role", "auditor", passwords=(PASSWORD,)) == 0
    assert verified(tmp_path, monkeypatch, capsys)["findings"] == []
    edit(tmp_path, eve=replace(accounts.load(tmp_path / "accounts.json")["eve"], role=Role.ENGINEER))
    assert verified(tmp_path, monkeypatch, capsys)["findings"] == ["account-changed"]


def test_a_line_that_holds_the_log_for_days_seals_changes_and_signatures(
    folder: Path,
    client: TestClient,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    database = folder / "station.db"
    with SqliteStore(database) as store, taking_requests(store, database):
        add = ("panel", "--add", "bob", "--role", "operator", "--by", "ada")
        assert station(folder, monkeypatch, *add, passwords=(PASSWORD, "bob's own one")) == 0
        assert log_in(client, "bob", "bob's own one") == 303
        remove = ("panel", "--remove", "bob", "--by", "ada")
        assert station(folder, monkeypatch, *remove, passwords=(PASSWORD,)) == 0
        assert log_in(client, "bob", "bob's own one") == 401
        sign = ("sign", "SN0001", "--by", "eve", "--meaning", "reviewed")
        assert station(folder, monkeypatch, *sign, passwords=(PASSWORD,)) == 0
        with pytest.raises(UsageError, match="already"):
            station(folder, monkeypatch, *sign, passwords=(PASSWORD,))
    assert verified(folder, monkeypatch, capsys)["findings"] == []


def test_an_owner_believes_neither_a_stranger_nor_what_the_log_does_not_know(folder: Path, forged: str) -> None:
    database, file = folder / "station.db", folder / "accounts.json"
    before = accounts.load(file)
    mallory = AccountChange("mallory", Account("mallory", Role.ENGINEER, forged))
    path = companion_file(database, Companion.SEALING)
    assert not hand_over(database, "account", {"file": str(file), **mallory.document()}), "nobody listens"
    with SqliteStore(database) as store, taking_requests(store, database):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        number = store.head().number
        for by in ("", "eve", "nobody"):
            with pytest.raises(UsageError, match="only an engineer"):
                hand_over(database, "account", {"file": str(file), **replace(mallory, by=by).document()})
        with SqliteLogReader(database) as log:
            (attempt,) = (a.attempt for a in log.attempts(Query(serial="SN0001")))
        signed = {"by": "mallory", "role": "engineer", "meaning": "released", "comment": "", "record": 1, "seal": ""}
        with pytest.raises(UsageError, match="not the one that the log has sealed"):
            hand_over(database, "signature", {"attempt": attempt, "detail": signed})
        with pytest.raises(StoreFault, match="holds no attempt"):
            hand_over(database, "signature", {"attempt": "x", "detail": signed | {"by": "ada"}})
        for rubbish in (b"", b"{}", b"[1]", b'{"kind": "account"}', b'{"kind": "shutdown"}', b"\xff" * 5000):
            assert ask(database, Companion.SEALING, rubbish, 0.05) is None
        assert store.head().number == number
    assert accounts.load(file) == before
    for place in (folder, *folder.parents[:3]):
        place.chmod(0o755)
    request = json.dumps({"kind": "account", "file": str(file), **replace(mallory, by="ada").document()}).encode()
    with SqliteStore(database) as store, taking_requests(store, database):
        path.chmod(0o666)  # were the socket open to everybody, the kernel would still name who writes
        with stranger():
            answer = ask(database, Companion.SEALING, request, 0.2)
    assert (answer == b"sealed") == (os.geteuid() != 0)  # whoever is not root cannot become somebody else


def test_lines_cut_off_while_the_page_serves_are_found(folder: Path) -> None:
    database, journal = folder / "station.db", Journal(folder / "station.db.panel.jsonl")
    seals = page_seals(folder)
    journal.add("ada", "start")
    assert not seals.step(1.0)
    assert not seals.step(LONGEST_UNSEALED_S)
    assert seals.step(LONGEST_UNSEALED_S + 1.0)
    for _ in range(MOST_UNSEALED_LINES):
        journal.add("ada", "log-in-refused")
    assert seals.step(LONGEST_UNSEALED_S + 2.0)
    assert not seals.step(LONGEST_UNSEALED_S + 3.0)
    lines = journal.path.read_bytes().splitlines(keepends=True)
    journal.path.write_bytes(b"".join(lines[:-1]))
    with SqliteLogReader(database) as log:
        state, found = journal_findings(log, database)
    assert [f.what for f in found] == ["truncated"]
    assert state.lines == MOST_UNSEALED_LINES


def test_a_run_seals_what_the_page_writes_meanwhile(folder: Path) -> None:
    database, journal = folder / "station.db", Journal(folder / "station.db.panel.jsonl")
    with SqliteStore(database) as store, sealing_journal(store, database) as sealer:
        for at_s, sealed in ((0.0, 0), (1.0, 0), (LONGEST_UNSEALED_S, 2), (2 * LONGEST_UNSEALED_S, 2)):
            if at_s <= 1.0:
                journal.add("ada", "log-in")
            sealer.step(at_s)
            with SqliteLogReader(database) as log:
                assert journal_findings(log, database)[0].sealed == sealed
        journal.add("ada", "stop")
    with SqliteLogReader(database) as log:
        assert journal_findings(log, database)[0].sealed == 3


def test_a_run_waits_for_a_seal_and_a_seal_for_no_run(folder: Path) -> None:
    database = folder / "station.db"
    seals = page_seals(folder)
    with SqliteStore(database):
        assert not seals.seal()
    holder = SqliteStore(database, brief=True)
    release = Timer(0.1, holder.close)
    release.start()
    SqliteStore(database).close()
    release.join()
    with SqliteStore(database), pytest.raises(StoreFault, match="in use"):
        SqliteStore(database)


def test_a_made_password_is_shown_once_it_is_in_force(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin", io.StringIO())
    Path("no-log.db").write_text("no log", "utf-8")
    with pytest.raises(LogError, match=r"no-log\.db cannot be read"):
        run_command(["panel", "--add", "anna", "--role", "engineer", "--db", "no-log.db"])
    assert capsys.readouterr().out == ""
    run_command(["panel", "--add", "anna", "--role", "engineer", "--db", "new.db"])
    shown = capsys.readouterr().out
    made = re.search(r"anna logs in with (\S+) ", shown)
    assert made is not None
    assert accounts.verify_password(made[1], accounts.load(tmp_path / "accounts.json")["anna"].password)


def test_a_demonstration_writes_no_account_where_an_engineer_would_have_to_vouch_for_it(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    people = folder / "other.json"
    with pytest.raises(ConfigError, match=r"other\.json holds no account"):
        station(folder, monkeypatch, "panel", "--simulate", "--port", "0", "--accounts", str(people))
    assert not people.exists()
