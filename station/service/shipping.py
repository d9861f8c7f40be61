"""One log on its way to one plant: in order, from where the plant stands, without anybody waiting for it.

The log itself is the store that is forwarded; the plant says how far it has come, so nothing is kept here that could
be lost. What the plant refuses stops this log there, until the plant takes it: records are chained, and none can be
left out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any

from station.domain.records.wire import WireRecord
from station.errors import LogError
from station.messages import Message, system_reason
from station.ports.clock import Clock
from station.ports.plant import Claim
from station.ports.shipping import ReceiverAnswer, ReceiverAway, RecordReceiver, RecordSource

SCHEMA = "station.shipping/1"
#: Reasons for which a plant takes nothing of the whole log.
APART = ("other-log", "other-station")
#: How long it rests when nothing is new, first and at most when the plant is away, and when a record is refused, s.
IDLE_S, FIRST_BACK_OFF_S, LAST_BACK_OFF_S, PARKED_S = 1.0, 0.5, 60.0, 30.0


class ShippingState(StrEnum):
    """What a shipment does."""

    SHIPPING = "shipping"
    UP_TO_DATE = "up-to-date"
    AWAY = "away"  # the plant cannot be reached
    PARKED = "parked"  # the plant refused a record


@dataclass(frozen=True, slots=True)
class ShippingStatus:
    """As the page and the metrics show it. number: shipped; newest: of the log; since_ns: of the state, where it is
    away or parked; refused: the parked record; message: why."""

    receiver: str
    state: ShippingState = ShippingState.SHIPPING
    number: int = 0
    newest: int = 0
    since_ns: int = 0
    sent_ns: int = 0
    refused: int = 0
    message: Message | None = None

    def document(self) -> dict[str, Any]:
        """As JSON."""
        return asdict(self) | {"message": self.message.document() if self.message else None}

    @staticmethod
    def of(document: Mapping[str, Any]) -> "ShippingStatus":
        """Of such a document. Errors: ValueError, KeyError, TypeError."""
        numbers = {name: int(document[name]) for name in ("number", "newest", "since_ns", "sent_ns", "refused")}
        message = Message.of(document["message"]) if document["message"] else None
        return ShippingStatus(str(document["receiver"]), ShippingState(document["state"]), message=message, **numbers)


def sentence_of(status: ShippingStatus) -> Message:
    """One line about one plant."""
    since = datetime.fromtimestamp(status.since_ns / 1e9, UTC).astimezone()
    return Message(
        f"shipping-state-{status.state}",
        receiver=status.receiver,
        number=status.number,
        behind=max(status.newest - status.number, 0),
        since=f"{since:%Y-%m-%d %H:%M:%S}",
        reason=status.message or "",
    )


class Shipment:
    """`step` does one thing and says for how long to rest. portion_bytes: of one portion; bytes_per_s: on average, or
    None. status: the present one; give the last one of an earlier process for the age of what is parked."""

    def __init__(
        self,
        source: RecordSource,
        receiver: RecordReceiver,
        clock: Clock,
        status: ShippingStatus,
        portion_bytes: int,
        bytes_per_s: float | None = None,
    ) -> None:
        self._source, self._receiver, self._clock = source, receiver, clock
        self.status = status
        self._portion_bytes, self._bytes_per_s = portion_bytes, bytes_per_s
        self._at: int | None = None
        self._back_off_s = 0.0

    def step(self) -> float:
        """One portion, or one question where the plant stands; seconds until the next step."""
        try:
            claim = self._source.newest()
            self.status = replace(self.status, newest=claim.newest)
            if self._at is None:
                return self._find_place(claim)
            if self._at >= claim.newest:
                self._become(ShippingState.UP_TO_DATE, newest=claim.newest)
                return IDLE_S
            records = self._source.read(self._at, self._portion_bytes)
            return self._settle(self._receiver.send(self._source.log_id, records, claim), claim, records)
        except OSError as error:
            why = error.message if isinstance(error, ReceiverAway) else system_reason(error)
            return self._away(Message("shipping-unreachable", why=why))
        except LogError as error:
            return self._away(error.message)

    def _find_place(self, claim: Claim) -> float:
        """From where to go on: behind the plant's last record, if this log has the same one there."""
        standing = self._receiver.standing(self._source.log_id)
        if standing.refused or standing.message:
            records = self._source.read(0, self._portion_bytes) if standing.reason in APART else []
            if records:  # so that the plant keeps what came under this name
                standing = self._receiver.send(self._source.log_id, records[:1], claim)
            return self._settle(standing, claim, [])
        if standing.number > claim.newest:
            return self._settle(self._receiver.send(self._source.log_id, [], claim), claim, [])
        if standing.number and self._source.seals(standing.number, standing.number) != [standing.seal]:
            departure = self._departure(standing.number)
            records = self._source.read(departure - 1, self._portion_bytes)
            answer = self._receiver.send(self._source.log_id, records[:1], claim)
            return self._settle(answer, claim, [])
        return self._settle(standing, claim, [])

    def _departure(self, last: int) -> int:
        """The first record that the plant has otherwise; by halves."""
        same, other = 0, last
        while other - same > 1:
            middle = (same + other) // 2
            theirs = self._receiver.seals(self._source.log_id, middle, middle)
            same, other = (middle, other) if theirs == self._source.seals(middle, middle) else (same, middle)
        return other

    def _settle(self, answer: ReceiverAnswer, claim: Claim, records: Sequence[WireRecord]) -> float:
        self._back_off_s = 0.0
        if answer.message is not None:
            self._at = None  # ask again where the plant stands: a person may have decided
            known = (self.status.state, self.status.refused) == (ShippingState.PARKED, answer.refused)
            since_ns = self.status.since_ns if known else self._clock.epoch_ns()
            self.status = replace(
                self.status,
                state=ShippingState.PARKED,
                number=answer.number,
                newest=claim.newest,
                refused=answer.refused,
                message=answer.message,
                since_ns=since_ns,
            )
            return PARKED_S
        progressed = self._at is None or answer.number > self._at
        self._at = answer.number
        if records and not progressed:
            return self._away(Message("shipping-no-progress", number=answer.number))
        if records:
            self.status = replace(self.status, sent_ns=self._clock.epoch_ns())
        self._become(ShippingState.SHIPPING, number=answer.number, newest=claim.newest)
        return sum(r.size for r in records) / self._bytes_per_s if self._bytes_per_s else 0.0

    def _become(self, state: ShippingState, **numbers: int) -> None:
        plain = replace(self.status, state=state, since_ns=0, refused=0, message=None)
        self.status = replace(plain, **numbers)  # type: ignore[arg-type]

    def _away(self, message: Message) -> float:
        away = self.status.state == ShippingState.AWAY
        since_ns = self.status.since_ns if away else self._clock.epoch_ns()
        state = self.status.state if self.status.state == ShippingState.PARKED else ShippingState.AWAY
        if state == ShippingState.AWAY:
            self.status = replace(self.status, state=state, since_ns=since_ns, message=message, refused=0)
        self._at = None
        self._back_off_s = min(max(2 * self._back_off_s, FIRST_BACK_OFF_S), LAST_BACK_OFF_S)
        return self._back_off_s
