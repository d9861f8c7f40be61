"""A short form of tests/endurance/torture_page.py, and `station stop`, which needs no page at all."""

import io
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from station.adapters.store.sqlite import SqliteStore
from station.cli.app import run_command
from station.errors import UsageError
from station.panel_protocol import accounts
from station.panel_protocol.accounts import Account, Role
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.journal import Journal
from station.panel_protocol.stop import request_stop
from station.web.connections import REQUEST_S, SOONEST, patience_s
from tests.endurance import torture_page

OWNER = """
import sys, time
from pathlib import Path
from station.adapters.store.sqlite import SqliteStore
store = SqliteStore(Path(sys.argv[1]), owner="bench-7", epoch_ns=time.time_ns)
try:
    print("ready", flush=True)
    time.sleep(60)
except KeyboardInterrupt:
    store.close()
    sys.exit(7)
"""


DEAF_OWNER = """
import signal, sys, time
from pathlib import Path
from station.adapters.store.sqlite import SqliteStore
from tests.fakes import logs
signal.signal(signal.SIGINT, lambda *_: None)
store = SqliteStore(Path(sys.argv[1]), owner="bench-7")
store.begin(logs.begin("SN1"))
print("ready", flush=True)
while True:
    time.sleep(60)
"""
ROOT = Path(__file__).parents[2]


def test_held_connections_and_guesses_keep_nobody_from_stop_or_log_in(tmp_path: Path) -> None:
    found = torture_page.attack(tmp_path, idle=210, slow=40, guesses=8, stops=11, guessers=8)
    assert (found.stops_unanswered, found.guesses, found.guesses_unanswered) == (0, 8, 0)
    assert (found.log_ins >= 2, found.refused, found.opened_by_guess) == (True, 0, 0)


@pytest.mark.parametrize("first", [0, 1, 12_345, 10**9])
def test_connections_of_one_instant_do_not_come_back_at_one_instant(first: int) -> None:
    patience = [patience_s(number) for number in range(first, first + 1000)]
    share, rest = divmod(REQUEST_S * (1 - SOONEST), 100 * 0.05)
    assert (share, rest) == (1, 0), "a hundred slices of 50 ms"
    slices = Counter(int((each - REQUEST_S * SOONEST) / 0.05) for each in patience)
    assert len(slices) == 100
    assert max(slices.values()) <= 12, "ten each, were they spread ideally"


def test_stop_reaches_whoever_writes_the_log(tmp_path: Path) -> None:
    words = [sys.executable, "-c", OWNER, str(tmp_path / "s.db")]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None
        assert owner.stdout.readline() == "ready\n"
        assert request_stop(tmp_path / "s.db") == owner.pid
        assert owner.wait(20) == 7


def test_only_an_engineer_ends_the_process_itself_and_what_is_left_is_recognised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The owner is deaf to stops, and holds an attempt open."""
    monkeypatch.setattr(accounts, "_N", 2**7)
    stored_hash = accounts.hash_password("correct horse")
    people = {name: Account(name, role, stored_hash) for name, role in (("ada", Role.ENGINEER), ("bob", Role.OPERATOR))}
    accounts.save(tmp_path / "accounts.json", people)
    words = [sys.executable, "-c", DEAF_OWNER, str(tmp_path / "s.db")]

    def kill(*more: str, password: str = "correct horse") -> int:
        monkeypatch.setattr(sys, "stdin", io.StringIO(f"{password}\n"))
        return run_command(["stop", "--db", str(tmp_path / "s.db"), *more])

    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, cwd=ROOT) as owner:
        assert owner.stdout is not None
        assert owner.stdout.readline() == "ready\n"
        assert [kill() for _ in range(3)] == [0, 0, 0]
        for more, sentence in (
            (("--kill",), "with --by NAME"),
            (("--kill", "--by", "bob"), "only an engineer"),
            (("--kill", "--by", "zoe"), "nobody called zoe"),
        ):
            with pytest.raises(UsageError, match=sentence):
                kill(*more)
        with pytest.raises(UsageError, match="the run goes on"):
            kill("--kill", "--by", "ada", password="a guess of it")
        assert owner.poll() is None
        assert kill("--kill", "--by", "ada") == 0
        assert owner.wait(20) == -signal.SIGKILL
    assert [line["deed"] for line in Journal(companion_file(tmp_path / "s.db", Companion.JOURNAL)).lines()] == ["kill"]
    with SqliteStore(tmp_path / "s.db") as store:
        assert [attempt.serial for attempt in store.unfinished()] == ["SN1"]


def test_without_a_run_there_is_nothing_to_stop(tmp_path: Path) -> None:
    SqliteStore(tmp_path / "s.db", owner="bench-7", epoch_ns=lambda: 1).close()
    with pytest.raises(UsageError, match=r"[Nn]o run"):
        request_stop(tmp_path / "s.db")
