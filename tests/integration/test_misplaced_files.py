"""Links, pipes and endless files in the places of files that belong to a log: refused or missed, never followed.

Whoever may write into the folder of a log, or of its heads, puts them there. None of them may make a command wait for
ever, take the machine's memory, or have the station write into a file of somebody's choice.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from station.adapters.store.anchor import AnchorFolder, head_file_path
from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.errors import ConfigError, LogError, StationError, StoreFault
from station.panel_protocol import accounts
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.journal import Journal
from station.panel_protocol.journal_seal import UnsealedLines, journal_findings
from station.panel_protocol.stop_socket import stop_by_socket
from station.ports.log_reader import Trust
from station.web.run_launcher import LaunchOptions, RunLauncher
from tests.fakes import logs

PRECIOUS = b"of somebody else"


def link(path: Path) -> None:
    path.symlink_to(victim(path))


def second_name(path: Path) -> None:
    os.link(victim(path), path)


def pipe(path: Path) -> None:
    os.mkfifo(path)


def endless(path: Path) -> None:
    """A terabyte without a block on the disk."""
    path.touch()
    os.truncate(path, 1 << 40)


def victim(path: Path) -> Path:
    (path.parent / "victim").write_bytes(PRECIOUS)
    return path.parent / "victim"


@pytest.fixture
def log(tmp_path: Path) -> Path:
    (tmp_path / "share").mkdir()
    (tmp_path / "line").mkdir()
    with opened(tmp_path / "line" / "station.db") as store:
        logs.unit(store)
    return tmp_path / "line" / "station.db"


def anchor_of(log: Path) -> AnchorFolder:
    return AnchorFolder(log.parents[1] / "share", "bench-station")


def opened(log: Path) -> SqliteStore:
    return SqliteStore(log, "bench", anchors=[anchor_of(log)])


def put(place: Path, harm: Callable[[Path], None]) -> None:
    place.unlink(missing_ok=True)
    harm(place)


@pytest.mark.parametrize("ending", ["-wal", "-shm", "-journal"])
@pytest.mark.parametrize("harm", [link, second_name, pipe, Path.mkdir])
def test_what_sqlite_would_follow_or_wait_for_is_refused(log: Path, ending: str, harm: Callable[[Path], None]) -> None:
    put(log.with_name(log.name + ending), harm)
    with pytest.raises(StoreFault, match=f"station.db{ending} is no file of its own"):
        opened(log)
    with pytest.raises(LogError, match=f"station.db{ending} is no file of its own"):
        SqliteLogReader(log)
    assert harm not in (link, second_name) or victim(log).read_bytes() == PRECIOUS


@pytest.mark.parametrize("harm", [link, pipe, endless, Path.mkdir])
@pytest.mark.parametrize("elsewhere", [True, False], ids=["anchor", "head file"])
def test_a_head_that_is_no_file_is_missed(log: Path, harm: Callable[[Path], None], *, elsewhere: bool) -> None:
    put(log.parents[1] / "share" / "bench-station.head" if elsewhere else head_file_path(log), harm)
    with pytest.raises(StoreFault, match="holds no head of a log"):
        opened(log)
    with SqliteLogReader(log) as reader:
        heads = {"share": None} if elsewhere and not _readable(anchor_of(log)) else {}
        assert [f.what for f in reader.findings(Trust(anchors=heads))] == ["unanchored"]


def _readable(anchor: AnchorFolder) -> bool:
    """`station audit --verify` takes a place that gives a ValueError for one without a head."""
    with pytest.raises(ValueError, match=r"ordinary|longer|link"):
        anchor.read()
    return False


@pytest.mark.parametrize("harm", [link, pipe, Path.mkdir])
def test_a_share_where_no_head_can_be_written_is_named_and_stops_nobody(
    log: Path, harm: Callable[[Path], None]
) -> None:
    harm(log.parents[1] / "share" / "bench-station.head.new")
    with opened(log) as store:
        logs.unit(store, "SN2")
        assert store._anchors.faults.keys() == {anchor_of(log).name}
    assert harm is not link or (log.parents[1] / "share" / "victim").read_bytes() == PRECIOUS


@pytest.mark.parametrize("harm", [pipe, endless, Path.mkdir])
def test_accounts_that_are_no_file_are_one_sentence(tmp_path: Path, harm: Callable[[Path], None]) -> None:
    harm(tmp_path / "accounts.json")
    with pytest.raises(ConfigError, match="not a readable list of accounts"):
        accounts.load(tmp_path / "accounts.json")


@pytest.mark.parametrize("harm", [link, second_name, pipe])
def test_neither_journal_nor_errors_of_a_run_go_into_another_file(log: Path, harm: Callable[[Path], None]) -> None:
    journal, errors = (companion_file(log, ending) for ending in (Companion.JOURNAL, Companion.ERRORS))
    harm(journal)
    with pytest.raises(StoreFault, match="cannot be written"):
        Journal(journal).add("ada", "log-in")
    if harm is pipe:
        assert not UnsealedLines(log).due(1.0)
        with SqliteLogReader(log) as reader:
            assert journal_findings(reader, log)[1] == []
    harm(errors)
    launcher = RunLauncher(LaunchOptions(log, "six-point", simulate=True))
    with pytest.raises(StationError, match="cannot be written"):
        launcher.start({}, "ada")
    assert launcher.pid() is None
    assert harm is pipe or (log.parent / "victim").read_bytes() == PRECIOUS
    assert launcher.last_words() in ("", PRECIOUS.decode())


def test_a_long_error_of_a_run_is_none(log: Path) -> None:
    endless(companion_file(log, Companion.ERRORS))
    assert RunLauncher(LaunchOptions(log, "six-point")).last_words() == ""


IMPOSTOR = """
import os, socket, sys
os.setgid(65534), os.setuid(65534)
ear = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
ear.bind(sys.argv[1])
print("ready", flush=True)
request, asker = ear.recvfrom(64)
os.chmod(sys.argv[1], 0o666)
ear.sendto(b"stopping 1", asker)
"""


def test_a_stop_that_somebody_else_answers_is_not_taken_for_done(log: Path) -> None:
    """A user of the machine who may write into the folder exchanges the run's socket for one of their own."""
    if os.geteuid() != 0:
        return  # nobody else can be tried
    for folder in log.parents:
        if not folder.stat().st_mode & 0o001:
            folder.chmod(0o755)
    log.parent.chmod(0o777)
    words = [sys.executable, "-c", IMPOSTOR, str(companion_file(log, Companion.STOP))]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as impostor:
        assert impostor.stdout is not None
        assert impostor.stdout.readline() == "ready\n"
        assert stop_by_socket(log, 5.0) is None
        assert impostor.wait(10) == 0, "it did answer"
