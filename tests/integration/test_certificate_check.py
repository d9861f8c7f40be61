"""`station certificate --check`: what the log makes is good, whatever happens later; what was altered is found."""

import hashlib
import json
import re
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from station.adapters.store import keys
from station.adapters.store.sqlite import SqliteStore
from station.cli.app import run_command
from station.domain.records.head import SealedHead
from station.domain.records.merkle import Tree
from station.domain.records.stored_attempt import SIGNED
from station.domain.records.tree_head import WITNESSED_EVENT, WitnessReceipt
from station.errors import StationError
from tests.conftest import SEED
from tests.endurance.log_attacks import unguarded
from tests.fakes import fixture_run, logs

#: By these words any of the messages of a difference is known.
FOUND = re.compile(
    r"the certificate says|does not verify|countersignature is not|holds no attempt|altered|can check|issued"
)
CONFIG = "schema: station.config/1\nnests: [{name: A, node: 17}]\nsigning_key: station.key\n"
WITNESS = "witness: {url: 'http://127.0.0.1:9', public_key: witness.key}\n"


@dataclass
class ByHand:
    """A witness that signs whatever it is shown, by its own arithmetic of RFC 9162 and of the receipt."""

    key: Ed25519PrivateKey
    station: Ed25519PrivateKey
    seals: Callable[[int], list[bytes]]
    name = "witness http://127.0.0.1:9"
    lags = True

    def read(self) -> SealedHead | None:
        return None

    def write(self, head: SealedHead, *, durable: bool) -> None:
        pass

    def submit(self, head: SealedHead, _tree: Tree, _replaces: str = "") -> WitnessReceipt:
        root = merkle([hashlib.sha256(b"\0" + seal).digest() for seal in self.seals(head.number)]).hex()
        own = self.station.public_key().public_bytes_raw().hex()
        parts = ("station.tree-head/1", head.log_id, head.station, str(head.number), root, head.hash, own)
        statement = hashlib.sha256("\n".join(parts).encode()).digest()
        signature = self.key.sign(hashlib.sha256(statement + b"1234567890").digest())
        return WitnessReceipt(head.number, root, 1234567890, signature.hex())


def merkle(hashes: list[bytes]) -> bytes:
    """The root over hashed leaves."""
    if len(hashes) == 1:
        return hashes[0]
    half = 1 << (len(hashes) - 1).bit_length() - 1
    return hashlib.sha256(b"\1" + merkle(hashes[:half]) + merkle(hashes[half:])).digest()


def write_key(path: Path) -> Ed25519PrivateKey:
    key = Ed25519PrivateKey.generate()
    pem = (serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    path.write_bytes(key.private_bytes(*pem))
    return key


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A signed, countersigned log of one unit, and its certificate in each format."""
    folder = tmp_path_factory.mktemp("check")
    station, witness = write_key(folder / "station.key"), write_key(folder / "witness.key")
    (folder / "config.yaml").write_text(CONFIG)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        fixture_run.run(folder, ["SN0001"], config=folder / "config.yaml")
        sign_by_hand(folder, witness, station)
        (folder / "config.yaml").write_text(CONFIG + WITNESS)
        written = [word for kind in ("pdf", "xml", "json") for word in (f"--{kind}", f"c.{kind}")]
        assert run_command(["certificate", "SN0001", *written, "--db", "station.db"]) == 0
        for more in (["--pdf", "zh.pdf", "--language", "zh"], ["--xml", "old.xml", "--dcc-version", "3.2.1"]):
            assert run_command(["certificate", "SN0001", *more, "--db", "station.db"]) == 0
        yield folder


def sign_by_hand(folder: Path, witness: Ed25519PrivateKey, station: Ed25519PrivateKey) -> None:
    """The log countersigned in the pause after its load."""
    database = folder / "station.db"
    signer = keys.Signer(station.sign, station.public_key().public_bytes_raw())
    place = ByHand(witness, station, lambda count: seals(database)[:count])
    with SqliteStore(database, "station-1", signer=signer, witness=place) as store:
        store.tidy()
        assert [e["size"] for _, _, e in store.station_events(WITNESSED_EVENT, 1)]


def seals(database: Path) -> list[bytes]:
    with closing(sqlite3.connect(database)) as db:
        tables = [t for (t,) in db.execute("SELECT m.name FROM sqlite_master m, pragma_table_info(m.name) c "
                                           "WHERE m.type = 'table' AND c.name = 'previous'")]  # fmt: skip
        rows = sorted(row for table in tables for row in db.execute(f'SELECT seq, hash FROM "{table}"'))
    return [seal for _, seal in rows]


def check(path: Path, capsys: pytest.CaptureFixture[str], *more: str) -> tuple[int, str]:
    """Exit code and every sentence, of the error as well."""
    capsys.readouterr()
    try:
        code = run_command(["certificate", "--check", str(path), "--db", "station.db", *more])
    except StationError as error:
        return error.exit_code, error.sentence
    return code, capsys.readouterr().out


def test_what_the_log_makes_is_good_and_stays_so(
    made: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(made)
    signer = keys.load_signer(made / "station.key")
    (seal, attempt) = (json.loads((made / "c.json").read_text())["log"][key] for key in ("seal", "attempt"))
    with SqliteStore(made / "station.db", "station-1", signer=signer) as store:
        logs.unit(store, "SN0002")
        detail = {"by": "ada", "role": "engineer", "meaning": "reviewed", "comment": ""}
        store.event(attempt, SIGNED, detail | {"record": seal["number"], "seal": seal["hash"]})
    for name in ("c.pdf", "zh.pdf", "c.xml", "old.xml", "c.json"):
        code, shown = check(made / name, capsys)
        good = "is as the log has it: SN0001" in shown and "checked with its key" in shown
        assert (code, good) == (0, True), shown
    code, shown = check(made / "c.json", capsys, "--key", "witness.key")
    assert (code, "does not verify" in shown) == (2, True), "another station's key"
    (made / "witness.key").rename(made / "w")
    write_key(made / "witness.key")
    assert check(made / "c.json", capsys) == (
        2,
        "The witness' key did not make its countersignature over the log as it is.\n",
    )
    (made / "w").rename(made / "witness.key")


def edits() -> dict[str, Callable[[Any], object]]:
    """What somebody alters in a JSON."""
    return {
        "value": lambda d: d["coefficients"][3].update(value=d["coefficients"][3]["value"] + 1e-12),
        "uncertainty": lambda d: d["coefficients"][0].update(expanded=0.0),
        "outcome": lambda d: d.update(outcome="FAIL"),
        "simulated": lambda d: d.update(simulated=0),
        "simulated left out": lambda d: d.pop("simulated"),
        "serial": lambda d: d["item"].update(serial="SN0002"),
        "number": lambda d: d.update(number="another"),
        "attempt": lambda d: d["log"].update(attempt="0" * 36),
        "date of measurement": lambda d: d["performed"].update(began="2030-01-01T00:00:00.000+00:00"),
        "a sentence more": lambda d: d.update(note="released"),
        "a signature": lambda d: d["signatures"].append({"by": "ada", "meaning": "released"}),
        "decision left out": lambda d: d["decisions"].pop(),
        "head of another log": lambda d: d["log"]["head"].update(hash="00" * 32),
        "later head": lambda d: d["log"]["head"].update(number=d["log"]["head"]["number"] + 999),
        "no countersignature": lambda d: d["log"].update(witness=None),
        "countersignature over more": lambda d: d["log"]["witness"].update(size=999),
        "another countersignature": lambda d: d["log"]["witness"].update(signature="ab" * 64),
        "seal": lambda d: d["log"]["seal"].update(hash="11" * 32),
    }


def test_whatever_is_altered_in_a_json_is_found(
    made: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(made)
    for name, edit in edits().items():
        document = json.loads((made / "c.json").read_text())
        edit(document)
        (tmp_path / "e.json").write_text(json.dumps(document))
        code, shown = check(tmp_path / "e.json", capsys)
        assert (code, bool(FOUND.search(shown))) == (2, True), f"{name}: {shown}"
    twice = (made / "c.json").read_text().replace('"outcome": "PASS"', '"outcome": "FAIL", "outcome": "PASS"', 1)
    for text in (twice, "[" * 100_000, "{}", "", "null", '{"schema": "station.certificate/1"}'):
        (tmp_path / "e.json").write_text(text)
        code, shown = check(tmp_path / "e.json", capsys)
        assert (code, "can check" in shown) == (2, True), text[:40]


def test_whatever_is_altered_in_a_pdf_or_dcc_is_found(
    made: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(made)
    rng = np.random.default_rng(SEED)
    data = (made / "c.pdf").read_bytes()
    forged = [
        data + b"\n%%EOF\n",
        data.replace(b"SN0001", b"SN0009"),
        data[:-1],
        data.replace(b"/Keywords", b"/Kezwords"),
    ]
    places = [(int(at), int(rng.integers(1, 256))) for at in rng.integers(0, len(data), 6)]
    forged += [data[:at] + bytes([data[at] ^ bits]) + data[at + 1 :] for at, bits in places]
    xml = (made / "c.xml").read_bytes()
    values = [m.span(1) for m in re.finditer(rb">([0-9]\.[0-9]+)<", xml)]
    for first, last in (values[i] for i in rng.choice(len(values), 5, replace=False)):
        forged.append(xml[:first] + b"1.5" + xml[last:])
    forged.append(xml.replace(b">pass<", b">fail<"))
    forged.append(xml.replace(b"SIMULATED", b"MEASURED!"))
    forged.append(re.sub(rb"<dcc:statement>.*?</dcc:statement>", b"", xml, count=1, flags=re.DOTALL))
    forged.append(re.sub(rb"<!--.*?-->", b"", xml))
    forged.append(xml.replace(b"</dcc:quantity>", b"</dcc:quantity>1.0", 1))
    for number, content in enumerate(forged):
        assert content not in (data, xml), number
        (tmp_path / "e").write_bytes(content)
        code, shown = check(tmp_path / "e", capsys)
        assert (code, bool(FOUND.search(shown))) == (2, True), f"{number}: {shown}"


def test_a_log_that_was_edited_vouches_for_nothing(
    made: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(made, tmp_path / "copy"))
    monkeypatch.chdir(folder)
    with unguarded(folder / "station.db") as db:
        db.execute("UPDATE result SET document = '{}' WHERE name = 'verdict'")
    for name in ("c.pdf", "c.xml", "c.json"):
        code, shown = check(folder / name, capsys)
        assert (code, "Nothing on the certificate is vouched for" in shown) == (2, True), shown


@pytest.mark.parametrize("words", [["SN0001", "--check", "c.pdf"], ["--check", "c.pdf", "--xml", "d.xml"], []])
def test_one_thing_at_a_time(made: Path, monkeypatch: pytest.MonkeyPatch, words: list[str]) -> None:
    monkeypatch.chdir(made)
    with pytest.raises(StationError, match=r"give it no SERIAL|Say which unit"):
        run_command(["certificate", *words, "--db", "station.db"])
