"""The log of a station on its way to its plants: a thread a plant, and one file that says how far each has come."""

import json
import ssl
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event, Lock, Thread

from station.adapters.clock import SystemClock
from station.adapters.shipping.client import PlantClient
from station.adapters.store.outbox import LogOutbox
from station.config.settings import ReceiverSettings, Settings
from station.errors import ConfigError, StationError, StoreFault
from station.files.json_text import NOT_AS_EXPECTED, read_json
from station.files.owner import OwnerLock
from station.files.replace import replace_text
from station.messages import Message, system_reason
from station.panel_protocol.companion import Companion, companion_file
from station.service.shipping import SCHEMA, Shipment, ShippingState, ShippingStatus

#: The file of the statuses is written so often at most, s.
REPORT_EVERY_S = 1.0


def read_statuses(database: Path) -> list[ShippingStatus]:
    """How far each plant has the log, as whoever ships last said; nothing where nobody ever shipped."""
    try:
        document = read_json(companion_file(database, Companion.SHIPPING))
        return [ShippingStatus.of(one) for one in document["receivers"]]
    except (OSError, *NOT_AS_EXPECTED):
        return []


def client_of(receiver: ReceiverSettings) -> PlantClient:
    """The plant of config.yaml. Errors: ConfigError."""
    token, tls = "", None
    try:
        if receiver.token_file:
            token = Path(receiver.token_file).read_text(encoding="ascii").strip()
        if receiver.url.startswith("https"):
            tls = ssl.create_default_context(cafile=receiver.authority or None)
            if receiver.certificate:
                tls.load_cert_chain(receiver.certificate, receiver.key or None)
    except (OSError, ValueError) as error:
        reason = system_reason(error) if isinstance(error, OSError) else Message.text(str(error))
        file = receiver.token_file or receiver.certificate or receiver.authority
        raise ConfigError("shipping-credentials", receiver=receiver.name, file=file, reason=reason) from error
    return PlantClient(receiver.url, token, receiver.timeout_s, tls)


@dataclass(slots=True)
class Shipping:
    """One process ships a log: `start` takes its lock. Errors: StoreFault where another process does; ConfigError."""

    database: Path
    settings: Settings
    _stop: Event = field(default_factory=Event)
    _threads: list[Thread] = field(default_factory=list)
    _statuses: dict[str, ShippingStatus] = field(default_factory=dict)
    _turn: Lock = field(default_factory=Lock)
    _settled: set[str] = field(default_factory=set)
    _lock: OwnerLock | None = None
    _reported_s: float = 0.0

    def start(self) -> None:
        """A thread for each plant."""
        clients = [(receiver, client_of(receiver)) for receiver in self.settings.receivers]
        what = Message("owned-shipping", path=str(self.database))
        lock = companion_file(self.database, Companion.SHIPPER)
        self._lock = OwnerLock(lock, what, self.settings.station, SystemClock().epoch_ns())
        earlier = {status.receiver: status for status in read_statuses(self.database)}
        for receiver, client in clients:
            status = earlier.get(receiver.name, ShippingStatus(receiver.name))
            self._statuses[receiver.name] = status
            thread = Thread(
                target=self._ship, args=(receiver, client, status), name=f"ship {receiver.name}", daemon=True
            )
            self._threads.append(thread)
            thread.start()

    def statuses(self) -> Sequence[ShippingStatus]:
        """How far each plant has the log."""
        with self._turn:
            return list(self._statuses.values())

    def wait_until_settled(self, until_s: float) -> bool:
        """Whether every plant has all that there is, or cannot take it now; answers at the latest at that instant."""
        clock = SystemClock()
        while clock.monotonic_s() < until_s and len(self._settled) < len(self._statuses):
            self._stop.wait(0.05)
        return len(self._settled) >= len(self._statuses)

    def stop(self) -> None:
        """Ends the threads; twice is harmless."""
        self._stop.set()
        for thread in self._threads:
            thread.join()
        self._threads.clear()
        if self._lock is not None:
            self._tell(at_once=True)
            self._lock.release()
            self._lock = None

    def _ship(self, receiver: ReceiverSettings, client: PlantClient, status: ShippingStatus) -> None:
        shipment = None
        while not self._stop.is_set():
            try:
                if shipment is None:
                    outbox = LogOutbox(self.database)
                    shipment = Shipment(
                        outbox, client, SystemClock(), status, receiver.portion_bytes, receiver.bytes_per_s
                    )
                rest_s = shipment.step()
                status = shipment.status
            except StationError:  # no log yet
                rest_s = 1.0
            with self._turn:
                changed = self._statuses[receiver.name].state != status.state
                if status.state != ShippingState.SHIPPING or shipment is None:
                    self._settled.add(receiver.name)
                self._statuses[receiver.name] = status
            self._tell(at_once=changed)
            if rest_s:
                self._stop.wait(rest_s)
        client.close()
        if shipment is not None:
            outbox.close()

    def _tell(self, *, at_once: bool) -> None:
        clock = SystemClock()
        with self._turn:
            if not at_once and clock.monotonic_s() < self._reported_s + REPORT_EVERY_S:
                return
            self._reported_s = clock.monotonic_s()
            rows = [status.document() for status in self._statuses.values()]
            document = {"schema": SCHEMA, "at_ns": clock.epoch_ns(), "receivers": rows}
            with suppress(OSError):  # a full disk stops no shipping
                replace_text(companion_file(self.database, Companion.SHIPPING), json.dumps(document))


@contextmanager
def shipping_in_background(database: Path, settings: Settings) -> Iterator[None]:
    """While the block lasts, the log is shipped by this process, unless another one does. Errors: ConfigError."""
    shipping = Shipping(database, settings) if settings.receivers else None
    try:
        if shipping is not None:
            shipping.start()
    except StoreFault:  # `station ship` does
        shipping = None
    try:
        yield
    finally:
        if shipping is not None:
            shipping.stop()
