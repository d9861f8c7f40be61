"""Where a run stands, as one frozen value folded from its events: what the operator's page shows, reload or not."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from station.domain.progress import (
    Event,
    Identified,
    LoadBegun,
    LoadDone,
    ObjectWritten,
    PhaseEntered,
    StopDone,
    StopStarted,
    Told,
    UnitDone,
    VisitRejected,
)

#: Sentences kept for a page that comes late.
MOST_SENTENCES = 20


@dataclass(frozen=True, slots=True)
class NestState:
    """One nest: the unit in it, its last mean reading (recipe's unit), and how its attempt ended ('' so far)."""

    serial: str
    nest: str
    node: int
    attempt: str = ""
    device: str = ""
    vector: tuple[float, ...] = ()
    noise: float | None = None
    outcome: str = ""
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class RunState:
    """The whole fixture. began_s and estimate_s: when this load began (epoch) and how long it should take."""

    recipe: str = ""
    unit: str = ""
    phase: str = "begin"
    position: str = ""
    following: str = ""
    done: int = 0
    total: int = 0
    began_s: float = 0.0
    estimate_s: float = 0.0
    over: bool = False
    nests: tuple[NestState, ...] = ()
    sentences: tuple[str, ...] = ()
    route: Mapping[str, str] = field(default_factory=dict)

    def after(self, event: Event, now_s: float) -> "RunState":
        """The state once `event` has happened at `now_s` (epoch)."""
        if isinstance(event, LoadBegun):
            nests = tuple(NestState(s.serial, s.nest, s.node) for s in event.seats)
            fresh = RunState(self.recipe, self.unit, route=self.route)
            return replace(fresh, total=event.stops, began_s=now_s, estimate_s=event.estimate_s, nests=nests)
        if isinstance(event, PhaseEntered):
            return replace(self, phase=str(event.phase))
        if isinstance(event, StopStarted):
            told = self._told(event.sentence) if event.sentence else self
            return replace(told, position=event.position, following=self.route.get(event.position, ""))
        if isinstance(event, StopDone):
            nests = tuple(replace(n, vector=tuple(event.means.get(n.serial, n.vector))) for n in self.nests)
            return replace(self, done=event.number, nests=nests)
        if isinstance(event, LoadDone):
            return replace(self, over=True, phase="done", position="", following="")
        return self._of_unit(event)

    def _of_unit(self, event: Event) -> "RunState":
        if isinstance(event, Identified):
            return self._nest(event.seat.serial, device=f"{event.name} {event.software}".strip())
        if isinstance(event, VisitRejected):
            words = "; ".join(r.sentence for r in event.reasons)
            return self._told(f"{event.serial}: {words}" + ("; measuring it again" if event.again else ""))
        if isinstance(event, Told):
            return self._told(f"{event.serial}: {event.sentence}" if event.serial else event.sentence)
        if isinstance(event, ObjectWritten):
            return replace(self, position=f"{event.name} ({event.number}/{event.total})", following="")
        if isinstance(event, UnitDone):
            r = event.result
            words = tuple(reason.sentence for reason in r.reasons)
            return self._nest(r.seat.serial, attempt=r.attempt, outcome=str(r.outcome), reasons=words, noise=r.noise)
        return self

    def _nest(self, serial: str, **changes: Any) -> "RunState":
        nests = tuple(replace(n, **changes) if n.serial == serial else n for n in self.nests)
        return replace(self, nests=nests)

    def _told(self, sentence: str) -> "RunState":
        return replace(self, sentences=(*self.sentences, sentence)[-MOST_SENTENCES:])
