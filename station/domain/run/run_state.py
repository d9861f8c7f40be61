"""Where a run stands, as one frozen value folded from its events: what the operator's page shows, reload or not."""

from dataclasses import dataclass, replace
from typing import Any

from station.domain.run.progress import (
    Event,
    Identified,
    LiveReading,
    LoadDone,
    LoadStarted,
    Notice,
    ObjectWritten,
    PhaseEntered,
    UnitDone,
    VisitDone,
    VisitRejected,
    VisitStarted,
)
from station.messages import Message

#: Messages held for a page that comes late.
MAX_MESSAGES = 20


@dataclass(frozen=True, slots=True)
class NestState:
    """One nest: the unit in it, its last mean reading and the standard deviation of one sample, both in the recipe's
    unit, and how its attempt ended ('' so far)."""

    serial: str
    nest: str
    node: int
    attempt: str = ""
    device: str = ""
    vector: tuple[float, ...] = ()
    noise: float | None = None
    outcome: str = ""
    reasons: tuple[Message, ...] = ()


@dataclass(frozen=True, slots=True)
class RunState:
    """The whole fixture. began_s and estimate_s: when this load began (epoch) and how long it should take.

    visits: every position of the load in its order, those of the verification last; at: number among them of the visit
    where the fixture is or goes to, -1 before the first; done: how many are over.
    instruction: what a person who turns the fixture must do; confirm: what somebody must do and then confirm, and
    question: the mark that the confirmation bears. fault: what ended the load for everybody.
    """

    visits: tuple[str, ...] = ()
    phase: str = "begin"
    position: str = ""
    following: str = ""
    at: int = -1
    instruction: Message | None = None
    confirm: Message | None = None
    question: str = ""
    writing: str = ""
    done: int = 0
    total: int = 0
    began_s: float = 0.0
    estimate_s: float = 0.0
    over: bool = False
    fault: Message | None = None
    nests: tuple[NestState, ...] = ()
    messages: tuple[Message, ...] = ()

    def after(self, event: Event, now_s: float) -> "RunState":
        """The state once `event` has happened at `now_s` (epoch)."""
        if isinstance(event, LoadStarted):
            nests = tuple(NestState(s.serial, s.nest, s.node) for s in event.seats)
            fresh = RunState(self.visits, following=self._stop(0), messages=self.messages)
            return replace(fresh, total=event.visits, began_s=now_s, estimate_s=event.estimate_s, nests=nests)
        if isinstance(event, PhaseEntered):
            return replace(self, phase=str(event.phase), writing="")
        if isinstance(event, VisitStarted | VisitDone | LiveReading):
            return self._after_visit_event(event)
        if isinstance(event, LoadDone):
            fault = None if event.fault is None else event.fault.message
            return replace(self, over=True, phase="done", position="", following="", instruction=None, fault=fault)
        return self._after_unit_event(event)

    def _after_visit_event(self, event: "VisitStarted | VisitDone | LiveReading") -> "RunState":
        if isinstance(event, VisitStarted):
            following = self._stop(self.done + 1)
            return replace(
                self, position=event.position, at=self.done, following=following, instruction=event.instruction
            )
        state = self
        for serial, vector in event.means.items():
            state = state._nest(serial, vector=tuple(vector))
        if isinstance(event, VisitDone):
            return replace(state, done=self.done + 1, instruction=None)
        for serial, noise in event.noise.items():
            state = state._nest(serial, noise=noise)
        return state

    def _after_unit_event(self, event: Event) -> "RunState":
        if isinstance(event, Identified):
            return self._nest(event.seat.serial, device=f"{event.name} {event.software}".strip())
        if isinstance(event, VisitRejected):
            return self._with_message(rejection(event))
        if isinstance(event, Notice):
            return self._with_message(with_unit(event.serial, event.message))
        if isinstance(event, ObjectWritten):
            return replace(self, writing=f"{event.name} ({event.number}/{event.total})")
        if isinstance(event, UnitDone):
            r = event.result
            why = tuple(reason.message for reason in r.reasons)
            return self._nest(r.seat.serial, attempt=r.attempt, outcome=str(r.outcome), reasons=why, noise=r.noise)
        return self

    def _stop(self, number: int) -> str:
        """Name of the visit of that number (from 0), '' past the last."""
        return self.visits[number] if number < len(self.visits) else ""

    def _nest(self, serial: str, **changes: Any) -> "RunState":
        nests = tuple(replace(n, **changes) if n.serial == serial else n for n in self.nests)
        return replace(self, nests=nests)

    def _with_message(self, message: Message) -> "RunState":
        return replace(self, messages=(*self.messages, message)[-MAX_MESSAGES:])


def with_unit(serial: str, message: Message) -> Message:
    """The message with the unit it is about; serial '' is the whole fixture, which needs no name."""
    return Message("about-unit", serial=serial, message=message) if serial else message


def rejection(event: VisitRejected) -> Message:
    """Why a visit does not count, and whether it is measured again."""
    reasons = tuple(reason.message for reason in event.reasons)
    if event.again:
        return Message("visit-measured-again", serial=event.serial, reasons=reasons)
    return Message("visit-rejected", serial=event.serial, reasons=reasons)
