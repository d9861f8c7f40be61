"""A file is replaced whole or not at all; a lock dies with whoever holds it."""

import contextlib
import os
import sqlite3
import stat
from pathlib import Path

import pytest

from station.files import lock
from station.files.replace import replace_text, replacing


@pytest.mark.parametrize("durable", [False, True])
def test_the_file_holds_the_new_text_and_nothing_else_is_left(tmp_path: Path, durable: bool) -> None:
    path = tmp_path / "a.json"
    replace_text(path, "one", durable=durable)
    replace_text(path, "two", durable=durable)
    assert path.read_text() == "two"
    assert list(tmp_path.iterdir()) == [path]


def test_no_file_takes_the_place_of_a_log(tmp_path: Path) -> None:
    log = tmp_path / "station.db"
    with contextlib.closing(sqlite3.connect(log)) as made:
        made.execute("create table records (a)")
    content = log.read_bytes()
    with pytest.raises(FileExistsError):
        replace_text(log, "a report")
    assert log.read_bytes() == content


def test_no_file_takes_the_place_of_a_pipe_or_a_device(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(OSError, match="pipe"):
        replace_text(pipe, "a report")
    assert pipe.is_fifo()


def test_what_fails_half_way_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    replace_text(path, "old")
    with pytest.raises(OSError, match="torn"), replacing(path) as part:
        part.write_text("half")
        assert part.suffix == ".csv", "writers go by the ending"
        raise OSError("torn")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_secret_is_readable_by_its_owner_only_from_the_first_byte_on(tmp_path: Path) -> None:
    path = tmp_path / "accounts.json"
    with replacing(path, mode=0o600) as part:
        assert stat.S_IMODE(part.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_a_shared_lock_shows_until_the_last_holder_closes_it(tmp_path: Path) -> None:
    path = tmp_path / "page.lock"
    assert not lock.is_held(path)
    handles = [lock.open_shared(path) for _ in range(2)]
    for handle in handles:
        assert lock.is_held(path)
        os.close(handle)
    assert not lock.is_held(path)
