"""One log, one owner, by whatever name it is reached."""

import os
import shutil
import sqlite3
import subprocess
import sys
import time
import unicodedata
from pathlib import Path

import pytest

from station.adapters.store import file
from station.adapters.store.sqlite import SqliteStore
from station.errors import StoreFault
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.owner import owner_pid
from tests.fakes import logs
from tests.fakes.waiting import until

ROOT = Path(__file__).parents[2]


def opened(path: Path) -> SqliteStore:
    return SqliteStore(path, owner="bench-7")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    (tmp_path / "real").mkdir()
    path = tmp_path / "real" / "station.db"
    opened(path).close()
    return path


@pytest.fixture
def names(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> dict[str, Path]:
    """Other ways to write the same file's path."""
    folder = tmp_path
    (folder / "file-link.db").symlink_to(log)
    (folder / "relative-link.db").symlink_to(Path("real") / log.name)
    (folder / "folder-link").symlink_to(log.parent)
    (folder / "chain.db").symlink_to(folder / "file-link.db")
    handle = os.open(log.parent, os.O_PATH)
    request.addfinalizer(lambda: os.close(handle))
    monkeypatch.chdir(log.parent)
    return {
        "file link": folder / "file-link.db",
        "relative link": folder / "relative-link.db",
        "link to the folder": folder / "folder-link" / log.name,
        "link to a link": folder / "chain.db",
        "dots": log.parent / ".." / log.parent.name / log.name,
        "relative": Path(log.name),
        "absolute": log.resolve(),
        "slashes": Path(f"{str(log).replace('/', '//')}/"),
        "dot": Path(f"{log.parent}/./././{log.name}"),
        "handle of the folder": Path(f"/proc/self/fd/{handle}/{log.name}"),
        "working folder": Path(f"/proc/self/cwd/{log.name}"),
        "root of the process": Path(f"/proc/self/root{log}"),
    }


def test_a_second_owner_is_refused_under_every_name(log: Path, names: dict[str, Path]) -> None:
    first = opened(log)
    for name, path in names.items():
        with pytest.raises(StoreFault, match="in use by bench-7"):
            opened(path)
        assert owner_pid(path) == os.getpid(), name
        assert companion_file(path, Companion.LIVE) == log.with_name("station.db.live.json").resolve()
    first.close()


def test_the_first_owner_may_have_come_by_a_link(log: Path, names: dict[str, Path]) -> None:
    first = opened(names["link to a link"])
    with pytest.raises(StoreFault, match="in use by bench-7"):
        opened(log)
    first.close()


#: Mounts that only this shell and what it starts can see: the folder, the file alone, the whole tree as a new root.
_MOUNTS = """
set -e
mount --bind "$1" "$2/folder"
mount --bind "$1/station.db" "$2/file/station.db"
mount --rbind / "$2/root"
"$3" -c "$4" "$2/folder/station.db" "$2/file/station.db"
chroot "$2/root" "$3" -c "$4" "$1/station.db"
"""
_SECOND_OWNER = """
import sys
import time
from pathlib import Path
from station.adapters.store.sqlite import SqliteStore
from station.errors import StoreFault
for name in sys.argv[1:]:
    try:
        SqliteStore(Path(name)).close()
    except StoreFault as refused:
        print("refused:", refused)
    else:
        print("opened:", name)
"""


def test_a_second_owner_is_refused_under_mounts_and_in_another_root(log: Path, tmp_path: Path) -> None:
    for name in ("folder", "file", "root"):
        (tmp_path / name).mkdir()
    (tmp_path / "file" / "station.db").touch()
    words = ["sh", "-c", _MOUNTS, "sh", str(log.parent), str(tmp_path), sys.executable, _SECOND_OWNER]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with opened(log) as store:
        for namespace in (["unshare", "-m"], ["unshare", "-Urm"]):
            command = [*namespace, *words]
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
            if done.returncode == 0:
                break
        assert [line.partition(":")[0] for line in done.stdout.splitlines()] == ["refused"] * 3, done
        store.event("", "note", {})


def test_other_letters_are_the_same_log_only_where_the_file_system_says_so(tmp_path: Path) -> None:
    """Composed, decomposed and in capitals: one file on some file systems, three on others, and never two owners."""
    log = tmp_path / "prüfstand.db"
    with opened(log):
        for other in (tmp_path / unicodedata.normalize("NFD", log.name), tmp_path / log.name.upper()):
            if other.exists():
                with pytest.raises(StoreFault, match="in use"):
                    opened(other)
            else:
                with opened(other) as second:
                    assert not second.path.samefile(log)


def test_a_hard_link_is_refused(log: Path, tmp_path: Path) -> None:
    (tmp_path / "second.db").hardlink_to(log)
    for path in (log, tmp_path / "second.db"):
        with pytest.raises(StoreFault, match="has 2 names"):
            opened(path)


def test_the_file_itself_is_locked_where_its_path_differs_too(log: Path) -> None:
    """As under a bind mount: another folder, so another lock file, and the same inode."""
    first = opened(log)
    with pytest.raises(StoreFault, match="in use under another path"):
        file.own_inode(log)
    first.close()
    os.close(file.own_inode(log))


def test_what_another_program_writes_meanwhile_ends_the_run_and_not_the_log(log: Path) -> None:
    store = opened(log)
    with sqlite3.connect(log) as other:
        seq, seal = other.execute("SELECT seq, hash FROM event ORDER BY seq DESC LIMIT 1").fetchone() or (0, b"")
        other.execute(
            "INSERT INTO event (seq, previous, hash, at_ns, kind, detail) VALUES (?, ?, ?, 1, 'foreign', '{}')",
            (seq + 1000, seal, b"x" * 32),
        )
    other.close()
    with pytest.raises(StoreFault, match="was written by another program after record"):
        store.event("", "note", {})
    store.close()


def test_a_program_that_changes_no_record_disturbs_nobody(log: Path) -> None:
    store = opened(log)
    with sqlite3.connect(log) as other:
        other.execute("CREATE TEMP TABLE t (x)")
    other.execute("PRAGMA wal_checkpoint")
    other.close()
    store.event("", "note", {})
    store.event("", "note", {})
    store.close()


def settled(folder: Path) -> bool:
    return time.time_ns() - folder.stat().st_ctime_ns > 2 * file.COARSE_TICK_NS


@pytest.mark.parametrize("ending", ["", "-wal", "-shm"])
@pytest.mark.parametrize("how", ["renamed", "removed", "exchanged"])
def test_a_log_that_is_moved_while_it_is_written_passes_nobody(log: Path, ending: str, how: str) -> None:
    with opened(log) as store:
        attempt = store.begin(logs.begin())
        until(lambda: settled(log.parent), "a folder that has not changed for a while")
        store.event(attempt, "note", {})
        file_ = Path(f"{log}{ending}")
        moved = file_.rename(f"{file_}.elsewhere")
        if how == "removed":
            moved.unlink()
        elif how == "exchanged":
            shutil.copy(moved, file_)
        with pytest.raises(StoreFault, match="renamed, removed or exchanged"):
            store.event(attempt, "note", {})
        with pytest.raises(StoreFault, match="renamed, removed or exchanged"):
            store.finish(attempt, "PASS", 1)


@pytest.mark.parametrize("another", [False, True])
def test_a_log_whose_folder_is_moved_passes_nobody(log: Path, *, another: bool) -> None:
    with opened(log) as store:
        attempt = store.begin(logs.begin())
        until(lambda: settled(log.parent), "a folder that has not changed for a while")
        store.event(attempt, "note", {})
        log.parent.rename(log.parent.with_name("elsewhere"))
        if another:
            shutil.copytree(log.parent.with_name("elsewhere"), log.parent)
        with pytest.raises(StoreFault, match="renamed, removed or exchanged"):
            store.event(attempt, "note", {})
