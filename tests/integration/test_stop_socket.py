"""The run's own ear for a stop: for its user and group, whatever else is sent to it, wherever the log lies."""

import json
import os
import socket
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.errors import StoreFault
from station.panel_protocol.account_seal import SEALED_EVENT, AccountChange
from station.panel_protocol.accounts import Account, Role
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.sealing_socket import hand_over
from station.panel_protocol.stop import request_stop
from station.panel_protocol.stop_socket import listening_for_stop, stop_by_socket
from station.ports.log_reader import Query
from tests.fakes.logs import stranger
from tests.fakes.waiting import until


def test_a_stop_is_heard_and_answered(tmp_path: Path) -> None:
    deep = tmp_path / ("a" * 100) / ("b" * 100)
    deep.mkdir(parents=True)
    heard: list[str] = []
    companion_file(deep / "s.db", Companion.STOP).touch()  # what a killed run left
    assert stop_by_socket(deep / "s.db") is None
    with listening_for_stop(deep / "s.db", heard.append):
        assert [stop_by_socket(deep / "s.db") for _ in range(3)] == [os.getpid()] * 3
    assert len(heard) == 3
    assert set(heard) != {"?"}
    assert stop_by_socket(deep / "s.db") is None
    assert list(deep.iterdir()) == []


def test_only_user_and_group_may_stop_or_hold_a_log(tmp_path: Path) -> None:
    database = tmp_path / "s.db"
    lock = companion_file(database, Companion.OWNER)
    lock.touch(mode=0o666)
    lock.chmod(0o666)  # as versions before this one left it
    with SqliteStore(database), listening_for_stop(database, lambda _: None):
        for path in (lock, companion_file(database, Companion.STOP)):
            assert stat.S_IMODE(path.stat().st_mode) == 0o660, path


def test_nobody_else_may_stop_it(tmp_path: Path) -> None:
    for folder in (tmp_path, *tmp_path.parents[:2]):
        folder.chmod(0o755)
    heard: list[str] = []
    with listening_for_stop(tmp_path / "s.db", heard.append), stranger():
        allowed = stop_by_socket(tmp_path / "s.db", 0.2) is not None
    assert allowed == bool(heard) == (os.geteuid() != 0)  # whoever is not root cannot become somebody else


def test_a_lock_that_is_a_link_is_not_written_over(tmp_path: Path) -> None:
    precious = tmp_path / "precious"
    precious.write_text("kept")
    companion_file(tmp_path / "s.db", Companion.OWNER).symlink_to(precious)
    with pytest.raises(StoreFault, match="symbolic link"):
        SqliteStore(tmp_path / "s.db")
    assert precious.read_text() == "kept"


def test_a_flood_of_rubbish_keeps_nobody_from_stopping(tmp_path: Path) -> None:
    heard: list[str] = []
    with listening_for_stop(tmp_path / "s.db", heard.append):
        path = str(companion_file(tmp_path / "s.db", Companion.STOP))
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as flood:
            for number in range(2000):
                flood.sendto(b"st" if number % 2 else bytes(1000), path)
        assert stop_by_socket(tmp_path / "s.db") == os.getpid()
    assert len(heard) == 1


def test_a_real_run_stops_and_says_who_stopped_it(tmp_path: Path) -> None:
    words = ["run", "--simulate", "--recipe", "six-point", "--units", "1", "--db", "s.db", "--pace", "1"]
    with subprocess.Popen(
        [sys.executable, "-m", "station", *words], cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as run:
        until(lambda: _running(tmp_path), "the run")
        added = AccountChange("ada", Account("ada", Role.ENGINEER, "scrypt$"))
        assert hand_over(tmp_path / "s.db", "account", {"file": str(tmp_path / "people.json"), **added.document()})
        assert request_stop(tmp_path / "s.db") == run.pid
        assert run.wait(60) == 4
    with SqliteLogReader(tmp_path / "s.db") as log:
        (attempt,) = log.attempts(Query())
        assert attempt.outcome == "ABORTED"
        assert [event.kind for event in log.station_events(SEALED_EVENT, 1)] == [SEALED_EVENT]
        assert "station stop" in json.dumps(log.attempt(attempt), ensure_ascii=False)


def _running(folder: Path) -> bool:
    """Whether the unit is being measured."""
    try:
        with SqliteLogReader(folder / "s.db") as log:
            return bool(log.running())
    except Exception:  # noqa: BLE001 - it is being made
        return False
