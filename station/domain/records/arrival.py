"""Records of a station's log as they arrive elsewhere: number, seal, signature and form of each, before it counts."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

from station.domain.records.chain import Value, genesis, link
from station.domain.records.json_object import json_object
from station.domain.records.key_schedule import KEY_EVENT, REVOKED_EVENT, rotation_statement
from station.domain.records.tables import COLUMNS, row_of
from station.domain.records.wire import WireRecord, parse
from station.messages import Message

#: A check of (public key, signature, statement).
Verify = Callable[[bytes, bytes, bytes], bool]


class RefusalReason(StrEnum):
    """Why a record is not taken."""

    OTHER_LOG = "other-log"  # the station's name comes with a second log
    OTHER_STATION = "other-station"  # the log is another station's, or says so
    FORK = "fork"  # the log had another record of this number before
    OLDER = "older"  # the log ends before what it had already shown
    GAP = "gap"
    TAMPERED = "tampered"  # breaks its seal, or does not follow the one before
    UNSIGNED = "unsigned"
    FORGED = "forged"  # not signed by the log's key
    REVOKED = "revoked"
    NEWER_SCHEMA = "newer-schema"
    UNKNOWN_ATTEMPT = "unknown-attempt"
    UNSTORABLE = "unstorable"


@dataclass(frozen=True, slots=True)
class RecordRefusal:
    """The first record that is not taken, and why. The message names station and number, and the way out."""

    reason: RefusalReason
    number: int
    message: Message


def refuse(reason: RefusalReason, station: str, number: int) -> RecordRefusal:
    """The refusal with its sentence."""
    return RecordRefusal(reason, number, Message(f"plant-{reason}", station=station, number=number))


@dataclass(frozen=True, slots=True)
class Tip:
    """How far a log has come. key: who signs, 32 bytes; revoked: last trusted record by key, hex; names: what its
    attempts may call the station."""

    log_id: str
    station: str
    key: bytes
    number: int = 0
    seal: bytes = b""
    signature: bytes = b""
    revoked: Mapping[str, int] = field(default_factory=dict)
    names: frozenset[str] = frozenset()

    @staticmethod
    def start(log_id: str, station: str, key: bytes, names: frozenset[str] = frozenset()) -> "Tip":
        """Of a log that nothing is known of yet."""
        return Tip(log_id, station, key, seal=genesis(log_id), names=names)


@dataclass(frozen=True, slots=True)
class ArrivedRecord:
    """A record that counts. values: in the order of its table's columns; its references are numbers of its log."""

    number: int
    table: str
    hash: bytes
    signature: bytes
    values: tuple[Value, ...]


@dataclass(slots=True)
class Arrival:
    """Takes records in the order of their numbers, until one is refused.

    Every record is signed but those before the log's first signature, which vouches for all before it: they are taken
    with it or not at all.
    """

    tip: Tip
    verify: Verify
    taken: list[ArrivedRecord] = field(default_factory=list)
    refusal: RecordRefusal | None = None
    _waiting: list[ArrivedRecord] = field(default_factory=list)

    def take(self, records: Sequence[WireRecord]) -> None:
        """The next records; `taken`, `tip` and `refusal` say what became of them."""
        settled = self.tip
        number, seal, signed = settled.number, settled.seal, bool(settled.signature)
        for record in records:
            reason = RefusalReason.GAP if record.number != number + 1 else self._next(record, seal, signed=signed)
            if reason is not None:
                self.refusal = refuse(reason, settled.station, number + 1)
                break
            number, seal, signed = record.number, record.hash, bool(record.signature)
            if signed:
                self.taken += self._waiting
                self._waiting.clear()
                settled = self.tip
        else:
            if self._waiting:
                self.refusal = refuse(RefusalReason.UNSIGNED, settled.station, self._waiting[0].number)
        if self.taken:
            last = self.taken[-1]
            settled = replace(settled, number=last.number, seal=last.hash, signature=last.signature)
        self.tip = settled

    def _next(self, record: WireRecord, seal: bytes, *, signed: bool) -> RefusalReason | None:
        """seal, signed: of the record before."""
        if link(seal, record.body) != record.hash:
            return RefusalReason.TAMPERED
        try:
            table, values = parse(record.body)
        except ValueError:
            table, values = "", {}
        if reason := self._signature(record, table, values, signed=signed):
            return reason
        row = row_of(table, values)
        if row is None:
            return RefusalReason.NEWER_SCHEMA
        if table == "attempt" and values["station"] not in (self.tip.names or {self.tip.station}):
            return RefusalReason.OTHER_STATION
        self._waiting.append(ArrivedRecord(record.number, table, record.hash, record.signature, row))
        return None

    def _signature(
        self, record: WireRecord, table: str, values: Mapping[str, Value], *, signed: bool
    ) -> RefusalReason | None:
        if not record.signature:
            return RefusalReason.UNSIGNED if signed else None
        if table == "event" and "attempt" not in values and values.get("kind") in (KEY_EVENT, REVOKED_EVENT):
            self._change_key(str(values["kind"]), str(values.get("detail", "")))
        if not self.verify(self.tip.key, record.signature, record.hash):
            return RefusalReason.FORGED
        revoked = self.tip.revoked
        if revoked and record.number > revoked.get(self.tip.key.hex(), record.number):
            return RefusalReason.REVOKED
        return None

    def _change_key(self, kind: str, detail: str) -> None:
        """The key that the log names from here on, where the old one signed it over; a key that ends.

        What is not in order leaves the old key, by which the record is then forged.
        """
        try:
            stored = json_object(detail)
            key, by_old = bytes.fromhex(stored["public_key"]), bytes.fromhex(stored.get("by_old", ""))
            beyond = int(stored.get("beyond", 0))
        except (ValueError, KeyError, TypeError, OverflowError):
            return
        old = self.tip.key
        if kind == REVOKED_EVENT:
            self.tip = replace(self.tip, revoked={**self.tip.revoked, key.hex(): beyond})
        elif key != old and by_old and self.verify(old, by_old, rotation_statement(self.tip.log_id, old, key)):
            self.tip = replace(self.tip, key=key)


#: Columns that hold the number of another record of the log, and of which table.
REFERENCES = {
    table: tuple((i, "attempt") for i, name in enumerate(names) if name == "attempt")
    + tuple((i, "document") for i, name in enumerate(names) if name in ("recipe", "product"))
    for table, names in COLUMNS.items()
}
