"""The plant's side of shipping: a portion of a log comes in, what holds is kept, what does not is set apart."""

from collections.abc import Sequence
from dataclasses import dataclass

from station.domain.records.arrival import Arrival, RecordRefusal, RefusalReason, Tip, Verify, refuse
from station.domain.records.wire import WireRecord
from station.ports.clock import Clock
from station.ports.plant import ArrivingLog, Claim, PlantStore


@dataclass(frozen=True, slots=True)
class RegisteredStation:
    """A station that may ship. public_key: the first key of its log, 32 bytes."""

    name: str
    public_key: bytes


@dataclass(frozen=True, slots=True)
class Standing:
    """How far the plant has a log: number and seal of the last record, and what it refused just now."""

    number: int
    seal: bytes
    refusal: RecordRefusal | None = None


class PlantReceiver:
    """verify(key, signature, statement): a signature check.

    Every portion is one transaction: what is answered as kept is on the disk, and the same portion again changes
    nothing. Errors of its calls: StoreFault while nothing can be kept.
    """

    def __init__(self, store: PlantStore, clock: Clock, verify: Verify) -> None:
        self._store, self._clock, self._verify = store, clock, verify

    def standing(self, station: RegisteredStation, log_id: str) -> Standing:
        """How far the plant has this log of the station."""
        with self._store.arriving(station.name, log_id, station.public_key) as log:
            return _standing(log, None)

    def seals(self, station: RegisteredStation, log_id: str, first: int, last: int) -> list[bytes]:
        """Seals of records as the plant has them, for a station that looks for the place where its log departs."""
        with self._store.arriving(station.name, log_id, station.public_key) as log:
            return log.seals(first, last) if log.tip else []

    def receive(self, station: RegisteredStation, log_id: str, records: Sequence[WireRecord], claim: Claim) -> Standing:
        """Takes what continues the log; the first record that does not is set apart with its reason."""
        at_ns = self._clock.epoch_ns()
        with self._store.arriving(station.name, log_id, station.public_key) as log:
            refusal = self._take(station, log_id, log, records, claim, at_ns)
            if refusal is not None:
                log.quarantine(refusal, records, at_ns)
            return _standing(log, refusal)

    def _take(
        self,
        station: RegisteredStation,
        log_id: str,
        log: ArrivingLog,
        records: Sequence[WireRecord],
        claim: Claim,
        at_ns: int,
    ) -> RecordRefusal | None:
        if log.other is not None:
            of_log, _ = log.other
            return _of_number(of_log, station.name, records[0].number if records else claim.newest)
        tip = log.tip or Tip.start(log_id, station.name, station.public_key)
        if refusal := _departure(log, tip, records, claim):
            return refusal
        new = [r for r in records if r.number > tip.number]
        return self._append(log, tip, new, claim, at_ns)

    def _append(
        self, log: ArrivingLog, tip: Tip, records: Sequence[WireRecord], claim: Claim, at_ns: int
    ) -> RecordRefusal | None:
        arrival = Arrival(tip, self._verify)
        arrival.take(records)
        refused = log.append(arrival.tip, arrival.taken, claim, at_ns)
        if refused is None:
            return arrival.refusal
        good = [r for r in records if r.number < refused.number]
        if good:  # those before it stand by themselves
            self._append(log, tip, good, claim, at_ns)
        return refused


def _departure(log: ArrivingLog, tip: Tip, records: Sequence[WireRecord], claim: Claim) -> RecordRefusal | None:
    """Where a record that the plant has comes with another seal, or the log now ends before what it had shown."""
    again = [r for r in records if r.number <= tip.number]
    if again:
        known = log.seals(again[0].number, again[-1].number)
        if len(known) == len(again):
            for record, seal in zip(again, known, strict=True):
                if record.hash != seal:
                    return refuse(RefusalReason.FORK, tip.station, record.number)
    if not records and claim.newest < tip.number:
        return refuse(RefusalReason.OLDER, tip.station, claim.newest + 1)
    return None


def _of_number(refusal: RecordRefusal, station: str, number: int) -> RecordRefusal:
    """The same refusal, of another record."""
    return refuse(refusal.reason, station, number)


def _standing(log: ArrivingLog, refusal: RecordRefusal | None) -> Standing:
    if log.other is not None and refusal is None:
        refusal, number = log.other
        return Standing(number, b"", refusal)
    tip = log.tip
    return Standing(tip.number, tip.seal, refusal) if tip else Standing(0, b"", refusal)
