"""A witness in a process of its own, over real HTTP: what it takes and refuses, and what a station learns from it."""

import json
import shutil
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from station.adapters.store import keys
from station.adapters.store.log_anchors import Acknowledgement
from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.adapters.witness.client import WitnessClient
from station.errors import StoreFault
from station.service.witnessed import newest_receipt
from tests.fakes import logs


def key_file(path: Path) -> Path:
    pem = (serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    path.write_bytes(Ed25519PrivateKey.generate().private_bytes(*pem))
    return path


class Served:
    """A witness: started, killed and started again on the same file."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.key = folder, key_file(folder / "witness.key")
        self.heads, self.port = folder / "heads.jsonl", "0"
        self.start()

    def start(self) -> None:
        words = ["--key", str(self.key), "--heads", str(self.heads), "--port", self.port]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "station", "witness", *words], stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout
        self.url = self.process.stdout.readline().split()[2].rstrip(";")
        self.port = self.url.rsplit(":", 1)[1]

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.communicate()

    def client(self, signer: keys.Signer, station: str = "bench-1") -> WitnessClient:
        public = keys.load_public_key(self.key)
        return WitnessClient(self.url, station, signer.public_key, signer.sign, public, keys.verify, 5.0)


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    (tmp_path / "elsewhere").mkdir()
    witness = Served(tmp_path / "elsewhere")
    yield witness
    witness.kill()


@pytest.fixture
def signer(tmp_path: Path) -> keys.Signer:
    return keys.load_signer(key_file(tmp_path / "station.key"))


def opened(path: Path, signer: keys.Signer, witness: WitnessClient, by: str = "") -> SqliteStore:
    accepted = Acknowledgement(by, "tried") if by else None
    return SqliteStore(path, "bench-1", signer=signer, witness=witness, acknowledgement=accepted)


def load(store: SqliteStore, serial: str) -> None:
    logs.unit(store, serial)
    store.tidy()


def events(path: Path, kind: str) -> list[dict[str, object]]:
    with SqliteLogReader(path) as log:
        return [json.loads(e.detail) for e in log.events() if e.kind == kind]


def copy(path: Path, to: Path) -> None:
    to.mkdir()
    for file in path.parent.glob("station.db*"):
        shutil.copy(file, to)


def test_each_load_is_receipted_once_and_a_killed_witness_goes_on(
    tmp_path: Path, served: Served, signer: keys.Signer
) -> None:
    path, witness = tmp_path / "station.db", served.client(signer)
    with opened(path, signer, witness) as store:
        load(store, "SN1")
        load(store, "SN2")
        store.tidy()
    served.kill()
    with opened(path, signer, witness) as store:
        load(store, "SN3")
    assert [e["place"] for e in events(path, "anchor-unwritten")] == [witness.name]
    served.start()
    with opened(path, signer, witness) as store:
        load(store, "SN4")
    with opened(path, signer, witness):
        pass
    sizes = [e["size"] for e in events(path, "witnessed")]
    assert len(sizes) == len(set(sizes)) >= 4
    assert len(served.heads.read_text().splitlines()) == len(sizes)
    with SqliteLogReader(path) as log:
        receipt = newest_receipt(log)
    assert receipt == events(path, "witnessed")[-1], "what certificates and exports carry"


def put_monday_back(path: Path, signer: keys.Signer, witness: WitnessClient) -> None:
    """Two loads, then the copy of after the first one in place of the log and all that lies beside it."""
    monday = path.parent / "monday"
    with opened(path, signer, witness) as store:
        load(store, "SN1")
    copy(path, monday)
    with opened(path, signer, witness) as store:
        load(store, "SN2")
    for file in monday.iterdir():
        shutil.copy(file, path.parent)


def test_a_restored_backup_is_refused_whatever_lies_beside_the_log(
    tmp_path: Path, served: Served, signer: keys.Signer
) -> None:
    path, witness = tmp_path / "station.db", served.client(signer)
    put_monday_back(path, signer, witness)
    with pytest.raises(StoreFault, match=r"witness http.* holds record .* an older copy was restored"):
        opened(path, signer, witness)
    with opened(path, signer, witness, by="Ada") as store:
        load(store, "SN3")
    with opened(path, signer, witness) as store:
        load(store, "SN4")
    replaced = [json.loads(line)["replaces"] for line in served.heads.read_text().splitlines()]
    assert len([r for r in replaced if r]) == 1  # kept for ever, by the witness too


def test_a_head_that_went_by_before_cannot_take_the_place_of_a_later_one(
    tmp_path: Path, served: Served, signer: keys.Signer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Somebody on the network, without any key, has kept what the station sent on Monday, replacements among it."""
    path, witness, sent = tmp_path / "station.db", served.client(signer), list[dict[str, object]]()
    ask = witness._ask

    def overheard(address: str, body: dict[str, Any] | None = None) -> dict[str, Any]:
        sent.extend([body] if body else [])
        return ask(address, body)

    monkeypatch.setattr(witness, "_ask", overheard)
    put_monday_back(path, signer, witness)
    with opened(path, signer, witness, by="Ada") as store:
        load(store, "SN3")
    with opened(path, signer, witness) as store:
        load(store, "SN4")
    newest = ask("/heads/bench-1")["head"]
    end = f"{newest['log_id']}:{newest['size']}:{newest['seal']}"
    assert [bool(body["replaces"]) for body in sent].count(True) == 1 < len(sent)
    for body in sent:
        for replaces in (body["replaces"], newest["log_id"], end):
            with pytest.raises(OSError, match=r"forged|older|fork"):
                ask("/heads", {**body, "replaces": replaces})
    assert ask("/heads/bench-1")["head"] == newest


def test_a_log_that_forked_is_found_although_it_is_longer(tmp_path: Path, served: Served, signer: keys.Signer) -> None:
    path, witness = tmp_path / "station.db", served.client(signer)
    with opened(path, signer, witness) as store:
        load(store, "SN1")
    copy(path, tmp_path / "fork")
    with opened(path, signer, witness) as store:
        load(store, "SN2")
    fork = tmp_path / "fork" / "station.db"
    with SqliteStore(fork, "bench-1", signer=signer) as store:  # without asking anybody
        for number in range(5):
            load(store, f"SN{number + 10}")
    with pytest.raises(StoreFault, match="holds another record"):
        opened(fork, signer, witness)


def test_who_asks_with_another_key_or_for_another_log_is_refused(
    tmp_path: Path, served: Served, signer: keys.Signer
) -> None:
    with opened(tmp_path / "station.db", signer, served.client(signer)) as store:
        load(store, "SN1")
    (tmp_path / "b").mkdir()
    other = keys.load_signer(key_file(tmp_path / "other.key"))
    with SqliteStore(tmp_path / "b" / "station.db", "bench-1", signer=other) as store:
        logs.unit(store)
    with pytest.raises(StoreFault, match="belongs to another log"):
        opened(tmp_path / "b" / "station.db", other, served.client(other))
    with pytest.raises(StoreFault, match="belongs to another log"):
        opened(tmp_path / "b" / "station.db", signer, served.client(signer))


NONSENSE = (b"", b"{}", b"[]", b"\xff", b'{"head": 1}', b"[" * 60_000, b"[" * 70_000, b'{"head": {}, "proof": [1]}')


def test_what_is_no_head_is_refused_in_one_answer(served: Served) -> None:
    for body in NONSENSE:
        request = urllib.request.Request(served.url + "/heads", body, {"content-type": "application/json"})
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(request, timeout=5)
        with refused.value as answer:
            assert (answer.code, json.loads(answer.read())) == (400, {"refused": "no-tree-head"}), body[:20]
