"""A short form of tests/endurance/torture_edits.py: whatever is done to the log behind the station's back is found."""

import sqlite3
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from station.adapters.store import keys
from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.domain.records.chain import IntegrityFinding
from station.errors import ConfigError, StoreFault, UsageError
from station.ports.log_reader import Trust
from tests.conftest import SEED
from tests.endurance import torture_edits
from tests.fakes import logs


def findings(path: Path, trust: Trust = Trust()) -> list[IntegrityFinding]:  # noqa: B008 - frozen
    with SqliteLogReader(path) as log:
        return list(log.findings(trust))


@pytest.fixture
def key_file(tmp_path: Path) -> Path:
    path = tmp_path / "station.key"
    pem = (serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    path.write_bytes(Ed25519PrivateKey.generate().private_bytes(*pem))
    return path


def test_every_random_edit_is_found(tmp_path: Path) -> None:
    path = tmp_path / "station.db"
    torture_edits.make(path)
    made, missed = torture_edits.torture(path, 400, SEED)
    assert missed == []
    assert made.total() == 400
    assert set(made) == {"change", "delete", "frames", "insert", "notes", "renumber", "swap", "truncate"}


def test_every_random_edit_of_a_signed_log_is_found(tmp_path: Path, key_file: Path) -> None:
    path = tmp_path / "station.db"
    torture_edits.make(path, keys.load_signer(key_file))
    assert torture_edits.torture(path, 150, SEED)[1] == []


@pytest.mark.parametrize(
    ("edit", "what", "sentences"),
    [
        ("UPDATE attempt SET serial = 'SN9'", "edited", "attempt record 3 was edited"),
        ("DELETE FROM result WHERE seq = 4", "deleted", "record 4 is missing"),
        ("DELETE FROM visit", "deleted", "records 5 to 6 are missing"),
        ("UPDATE visit SET seq = 99 WHERE seq = 6", "deleted", "record 6 is missing"),
        ("DELETE FROM archive", "truncated", "the log ends at record 11 but once reached 12"),
        ("UPDATE head SET number = 3", "edited", "the log's own note"),
    ],
)
def test_the_edited_record_is_named(tmp_path: Path, edit: str, what: str, sentences: str) -> None:
    path = tmp_path / "station.db"
    with SqliteStore(path) as store:
        logs.unit(store)
    with logs.unguarded(path) as db:
        db.execute(edit)
    assert any(f.what == what and sentences in f.sentence for f in findings(path))


def test_a_guard_that_was_taken_off_is_named(tmp_path: Path) -> None:
    path = tmp_path / "station.db"
    SqliteStore(path).close()
    db = sqlite3.connect(path)
    db.execute("DROP TRIGGER visit_no_delete")
    db.close()
    assert [(f.what, f.kind) for f in findings(path)] == [("unguarded", "trigger visit_no_delete")]


def test_a_log_rebuilt_by_somebody_else_shows_against_key_and_printed_head(tmp_path: Path, key_file: Path) -> None:
    real, forged = tmp_path / "station.db", tmp_path / "forged" / "station.db"
    forged.parent.mkdir()
    with SqliteStore(real, signer=keys.load_signer(key_file)) as store:
        logs.unit(store, outcome="FAIL")
        head = store.head()
    with SqliteStore(forged) as store:
        logs.unit(store, outcome="PASS")
    public = keys.load_public_key(key_file)
    printed = {head.number: bytes.fromhex(head.hash)}
    assert findings(real, Trust(printed, public)) == []
    assert findings(real) == []
    assert [f.what for f in findings(forged, Trust(public_key=public))] == ["unsigned"]
    assert [f.what for f in findings(forged, Trust(printed))] == ["truncated"]


def test_a_key_that_is_none_is_one_sentence(tmp_path: Path, key_file: Path) -> None:
    assert keys.load_public_key(key_file) == keys.load_signer(key_file).public_key
    wrong = tmp_path / "wrong.key"
    wrong.write_text("hello")
    for broken in (wrong, tmp_path / "none.key"):
        with pytest.raises(ConfigError, match=r"PEM|no station key"):
            keys.load_signer(broken)
        with pytest.raises(UsageError, match=r"PEM|cannot be read"):
            keys.load_public_key(broken)


ADDED = {
    "a trigger that swallows finishes": "CREATE TRIGGER t BEFORE INSERT ON finish BEGIN SELECT RAISE(IGNORE); END",
    "a trigger that swallows frames": "CREATE TRIGGER t BEFORE INSERT ON frames BEGIN SELECT RAISE(IGNORE); END",
    "a trigger that takes a finish away again": (
        "CREATE TRIGGER t AFTER INSERT ON finish BEGIN DELETE FROM finish WHERE seq = NEW.seq; END"
    ),
    "a view": "CREATE VIEW passed AS SELECT * FROM attempt",
    "an index that refuses a second unit": "CREATE UNIQUE INDEX one_serial ON attempt(station)",
    "a guard of another meaning": (
        "DROP TRIGGER finish_no_delete; CREATE TRIGGER finish_no_delete BEFORE DELETE ON visit BEGIN SELECT 1; END"
    ),
}


@pytest.mark.parametrize("how", ADDED)
def test_whatever_was_added_to_the_schema_is_named_and_the_log_refused(tmp_path: Path, how: str) -> None:
    path = tmp_path / "station.db"
    SqliteStore(path).close()
    db = sqlite3.connect(path)
    db.executescript(ADDED[how])
    db.close()
    assert {f.what for f in findings(path)} == {"unguarded"}
    with pytest.raises(StoreFault, match="has been altered"):
        SqliteStore(path)


@pytest.mark.parametrize("how", [how for how in ADDED if "finish" in how and "guard" not in how])
def test_a_finish_that_is_swallowed_meanwhile_is_a_fault_and_no_pass(tmp_path: Path, how: str) -> None:
    path = tmp_path / "station.db"
    with SqliteStore(path) as store:
        attempt = store.begin(logs.begin())
        other = sqlite3.connect(path)
        other.executescript("DROP TRIGGER finish_no_delete;" + ADDED[how])
        other.close()
        with pytest.raises(StoreFault, match=r"drops records|does not show record"):
            store.finish(attempt, "PASS", 1)
