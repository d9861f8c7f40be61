"""A person with the files: tails cut, backups restored, heads lost, emptied or exchanged. Refused, and found."""

import os
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from station.adapters.store.anchor import AnchorFolder, head_file_path
from station.adapters.store.keys import Signer
from station.adapters.store.log_anchors import Acknowledgement
from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.config.settings import AnchorSettings, load_settings
from station.domain.records.head import SealedHead
from station.errors import ConfigError, StoreFault
from station.ports.log_reader import Trust
from station.wiring.logs import open_store
from tests.fakes import logs

KEY = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
SIGNER = Signer(KEY.sign, KEY.public_key().public_bytes_raw())


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "line").mkdir()
    (tmp_path / "share").mkdir()
    return tmp_path / "line" / "station.db"


def folder(path: Path, *, write_once: bool = False) -> AnchorFolder:
    return AnchorFolder(path.parents[1] / "share", "bench-station", write_once)


def opened(path: Path, *anchors: AnchorFolder, signer: Signer | None = SIGNER, by: str = "") -> SqliteStore:
    accepted = Acknowledgement(by, "tried") if by else None
    return SqliteStore(path, "bench", signer=signer, anchors=anchors, acknowledgement=accepted)


def files(path: Path) -> list[Path]:
    return [f for f in path.parent.iterdir() if f.name.startswith("station.db") and not f.name.endswith(".lock")]


def back_up(path: Path, place: Path) -> None:
    place.mkdir()
    for file in files(path):
        shutil.copy(file, place)


def restore(path: Path, place: Path) -> None:
    for file in files(path):
        file.unlink()
    for file in place.iterdir():
        shutil.copy(file, path.parent)


def found(path: Path, *anchors: AnchorFolder) -> set[str]:
    heads = {a.name: a.read() for a in anchors}
    with SqliteLogReader(path) as log:
        return {f.what for f in log.findings(Trust(public_key=SIGNER.public_key, anchors=heads))}


@pytest.mark.parametrize("write_once", [False, True])
def test_a_restored_backup_with_its_head_is_found_by_one_anchor_elsewhere(path: Path, *, write_once: bool) -> None:
    share = folder(path, write_once=write_once)
    with opened(path, share) as store:
        logs.unit(store)
    back_up(path, path.parents[1] / "monday")
    with opened(path, share) as store:
        logs.unit(store, "SN2")
    restore(path, path.parents[1] / "monday")
    assert found(path) == set()  # nothing beside the log can know
    assert found(path, share) == {"truncated"}
    with pytest.raises(StoreFault, match="an older copy was restored"):
        opened(path, share)
    with opened(path, share, by="Ada") as store:
        logs.unit(store, "SN3")
    assert found(path, share) == set()
    with SqliteLogReader(path) as log:
        assert [(a["by"], a["reason"], [f["what"] for f in a["findings"]]) for a in log.acknowledgements()] == [
            ("Ada", "tried", ["truncated"])
        ]


def lost(path: Path) -> None:
    head_file_path(path).unlink()


def emptied(path: Path) -> None:
    head_file_path(path).write_bytes(b"")


def zero(path: Path) -> None:
    stored = SealedHead.parse(head_file_path(path).read_text())
    head_file_path(path).write_text(SealedHead(stored.log_id, stored.station, 0, "00" * 32).line())


def foreign(path: Path) -> None:
    other = path.parent / "other.db"
    with opened(other) as store:
        logs.unit(store)
    shutil.copy(head_file_path(other), head_file_path(path))


def nonsense(path: Path) -> None:
    head_file_path(path).write_text("{}")


def unsigned(path: Path) -> None:
    stored = SealedHead.parse(head_file_path(path).read_text())
    head_file_path(path).write_text(SealedHead(stored.log_id, stored.station, stored.number, stored.hash).line())


def older(path: Path) -> None:
    db = sqlite3.connect(path)
    number, seal, signature = db.execute("SELECT seq, hash, signature FROM attempt ORDER BY seq LIMIT 1").fetchone()
    db.close()
    stored = SealedHead.parse(head_file_path(path).read_text())
    head = SealedHead(stored.log_id, stored.station, number, seal.hex(), signature.hex())
    head_file_path(path).write_text(head.line())


@pytest.mark.parametrize("harm", [lost, emptied, zero, foreign, nonsense, unsigned, older])
def test_a_head_that_is_not_the_logs_own_newest_is_refused_and_found(path: Path, harm: Callable[[Path], None]) -> None:
    with opened(path) as store:
        for serial in ("SN1", "SN2", "SN3"):
            logs.unit(store, serial)
    harm(path)
    assert found(path) <= {"unanchored", "forged"}
    assert found(path)
    for _ in range(2):
        with pytest.raises(StoreFault, match="is not as it was left"):
            opened(path)
    opened(path, by="Ada").close()
    assert found(path) == set()
    opened(path).close()


@pytest.mark.parametrize("how", ["removed", "emptied"])
def test_a_log_that_was_removed_or_emptied_beside_its_head_is_no_new_log(path: Path, how: str) -> None:
    with opened(path) as store:
        logs.unit(store)
    if how == "removed":
        path.unlink()
    else:
        path.write_bytes(b"")
    with pytest.raises(StoreFault, match="belongs to another log"):
        opened(path)


def test_a_share_that_is_away_stops_nobody_and_lags_rightly(path: Path) -> None:
    share = folder(path)
    with opened(path, share) as store:
        logs.unit(store)
    away = path.parents[1] / "away"
    share.folder.rename(away)
    with opened(path, share) as store:
        logs.unit(store, "SN2")
        logs.unit(store, "SN3")
    with SqliteLogReader(path) as log:
        assert [e.kind for e in log.events()].count("anchor-unwritten") == 1
    away.rename(share.folder)
    with opened(path, share) as store:
        logs.unit(store, "SN4")
    assert found(path, share) == set()


def test_an_anchor_that_was_emptied_is_missed(path: Path) -> None:
    share = folder(path)
    with opened(path, share) as store:
        logs.unit(store)
    for file in share.folder.iterdir():
        file.unlink()
    with pytest.raises(StoreFault, match="is missing, although the log's head was kept there"):
        opened(path, share)


def test_a_death_at_any_moment_leaves_a_head_that_is_gone_on_with(path: Path) -> None:
    """The head file may lag by what one crash leaves: the newest finish and what follows it."""
    with opened(path) as store:
        logs.unit(store)
        stored = head_file_path(path).read_bytes()
        logs.unit(store, "SN2")
        store.event("", "log-in", {})
    head_file_path(path).write_bytes(stored)
    opened(path).close()


HOUR_NS = 3600 * 10**9


def begun(path: Path, at_ns: int, by: str = "") -> SqliteStore:
    accepted = Acknowledgement(by, "the clock was a year ahead") if by else None
    return SqliteStore(path, epoch_ns=lambda: at_ns, acknowledgement=accepted)


def test_a_clock_set_back_is_an_event_and_beyond_a_day_a_refusal(path: Path) -> None:
    now_ns = 1_800_000_000 * 10**9
    with begun(path, now_ns) as store:
        logs.unit(store, started_ns=now_ns)
    begun(path, now_ns - 30 * 10**9).close()
    begun(path, now_ns - 2 * HOUR_NS).close()
    with SqliteLogReader(path) as log:
        assert [e.kind for e in log.events()] == ["clock-back"]
    with pytest.raises(StoreFault, match=r"the clock is 25\.0 h behind"):
        begun(path, now_ns - 25 * HOUR_NS)
    begun(path, now_ns - 25 * HOUR_NS, by="Ada").close()
    begun(path, now_ns - 25 * HOUR_NS).close()


def exchanged(head: Path) -> None:
    shutil.copy(head, head.with_name("copy"))
    head.with_name("copy").replace(head)


def link_put_in_place(head: Path) -> None:
    head.symlink_to(head.rename(head.with_name("moved")))


def second_name(head: Path) -> None:
    head.with_name("second").hardlink_to(head)


@pytest.mark.parametrize("harm", [Path.unlink, exchanged, link_put_in_place, second_name])
def test_a_head_file_exchanged_under_the_hands_of_a_run_lets_no_further_unit_begin(
    path: Path, harm: Callable[[Path], None]
) -> None:
    with opened(path) as store:
        logs.unit(store)
        harm(head_file_path(path))
        with pytest.raises(StoreFault, match="no longer the one at that path"):
            logs.unit(store, "SN2")


def test_the_head_file_is_written_over_and_never_replaced(path: Path) -> None:
    opened(path).close()
    with head_file_path(path).open("rb") as held:  # as long as somebody has it open, no other file gets its number
        for serial in ("SN1", "SN2", "SN3"):
            with opened(path) as store:
                logs.unit(store, serial)
                store.tidy()
            assert os.path.samestat(os.fstat(held.fileno()), head_file_path(path).lstat())


def test_a_link_in_place_of_a_head_is_not_written_through(path: Path) -> None:
    victim = path.parent / "accounts.json"
    victim.write_text("{}")
    head_file_path(path).symlink_to(victim)
    for by in ("", "Ada"):
        with pytest.raises(StoreFault, match=r"symbolic link|[Uu]nreadable|head"):
            opened(path, by=by)
    assert victim.read_text() == "{}"


def test_anchors_that_are_one_folder_under_two_names_are_refused(path: Path) -> None:
    share, alias = path.parents[1] / "share", path.parents[1] / "alias"
    alias.symlink_to(share)
    own = path.parents[1] / "own"
    own.symlink_to(path.parent)
    for first, second in ((share, alias), (share, own)):
        anchors = tuple(AnchorSettings(folder=str(folder)) for folder in (first, second))
        settings = load_settings().model_copy(update={"anchors": anchors})
        with pytest.raises(ConfigError, match="are one folder"):
            open_store(path, settings, lambda: 1)
