"""Where a run stands, as one frozen value folded from its events: what the operator's page shows, reload or not."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from station.domain.core.folded_reasons import folded
from station.domain.core.types import Outcome
from station.domain.run.headline import Headline, headline
from station.domain.run.progress import (
    Event,
    Identified,
    Judged,
    LiveReading,
    LoadDone,
    LoadStarted,
    Notice,
    ObjectWritten,
    Phase,
    PhaseEntered,
    UnitDone,
    UnitResult,
    VisitDone,
    VisitRejected,
    VisitStarted,
)
from station.messages import Message

#: What is done with each unit, in this order.
STEPS = ("identify", "measure", "write", "verify")
#: Messages held for a page that comes late.
MAX_MESSAGES = 20


#: The phases with which all units enter a step together; they leave the first and the second each at its own time.
_STEP_OF_PHASE: Mapping[Phase, str] = {Phase.IDENTIFY: "identify", Phase.VERIFY: "verify"}


@dataclass(frozen=True, slots=True)
class NestState:
    """One nest: the unit in it, its last mean reading and the standard deviation of one sample, both in the recipe's
    unit, and how its attempt ended ('' so far).

    step: what is done with it, one of STEPS, '' before and after; since_s: since when (epoch); took_s: durations of the
    steps that are over. figure: the value that its verdict hangs on (station.domain.run.headline).
    """

    serial: str
    nest: str
    node: int
    attempt: str = ""
    device: str = ""
    vector: tuple[float, ...] = ()
    noise: float | None = None
    outcome: str = ""
    reasons: tuple[Message, ...] = ()
    step: str = ""
    since_s: float = 0.0
    took_s: tuple[float, ...] = ()
    figure: Headline | None = None

    def entering(self, step: str, now_s: float) -> "NestState":
        """The nest once its unit goes on to that step."""
        took_s = (*self.took_s, round(now_s - self.since_s, 2)) if self.step else self.took_s
        return replace(self, step=step, since_s=now_s, took_s=took_s)


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
            return replace(self._entering(_STEP_OF_PHASE.get(event.phase, ""), now_s), phase=event.phase, writing="")
        if isinstance(event, VisitStarted | VisitDone | LiveReading):
            return self._after_visit_event(event)
        if isinstance(event, LoadDone):
            fault = None if event.fault is None else event.fault.message
            return replace(self, over=True, phase="done", position="", following="", instruction=None, fault=fault)
        return self._after_unit_event(event, now_s)

    def _entering(self, step: str, now_s: float) -> "RunState":
        """Every unit that goes on enters the step; '' is none."""
        if not step:
            return self
        nests = tuple(n if n.outcome or n.step == step else n.entering(step, now_s) for n in self.nests)
        return replace(self, nests=nests)

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
        return replace(state, instruction=None)  # every unit is up and still: the person has done it

    def _after_unit_event(self, event: Event, now_s: float) -> "RunState":
        if isinstance(event, Identified | Judged):
            return self._after_step(event, now_s)
        if isinstance(event, VisitRejected):
            return self._with_message(rejection(event))
        if isinstance(event, Notice):
            return self._with_message(with_unit(event.serial, event.message))
        if isinstance(event, ObjectWritten):
            return replace(self, writing=f"{event.name} ({event.number}/{event.total})")
        return self._after_end(event.result, now_s) if isinstance(event, UnitDone) else self

    def _after_step(self, event: Identified | Judged, now_s: float) -> "RunState":
        if isinstance(event, Identified):
            named = self._nest(event.seat.serial, device=f"{event.name} {event.software}".strip())
            return named._goes_on(event.seat.serial, "measure", now_s)
        passed = event.fit.verdict.outcome is Outcome.PASS
        return self._goes_on(event.seat.serial, "write", now_s) if passed else self

    def _after_end(self, r: UnitResult, now_s: float) -> "RunState":
        why = tuple(reason.message for reason in r.reasons)
        return self._goes_on(r.seat.serial, "", now_s)._nest(
            r.seat.serial, attempt=r.attempt, outcome=r.outcome, reasons=why, noise=r.noise, figure=headline(r)
        )

    def _goes_on(self, serial: str, step: str, now_s: float) -> "RunState":
        return replace(self, nests=tuple(n.entering(step, now_s) if n.serial == serial else n for n in self.nests))

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
    reasons = tuple(folded(event.reasons))
    if event.again:
        return Message("visit-measured-again", serial=event.serial, reasons=reasons)
    return Message("visit-rejected", serial=event.serial, reasons=reasons)
