"""Raw frames of stored attempts as one recording with marks, each attempt apart from the others."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import ValidationError

from station.domain.capture.annotations import Annotation, Annotations, annotate_visits
from station.domain.capture.visit import CapturedVisit
from station.domain.core.types import Frames, NestAssignment
from station.domain.records import stored_attempt
from station.errors import UsageError
from station.ports.log_reader import Attempt, LogReader
from station.service.recompute import parse_recipe_and_product, stored_visits

#: Between attempts that are moved apart.
PAUSE_NS = 1_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class _RecordedAttempt:
    """An attempt with its frames, those of verification too, and the tumble's visits."""

    attempt: Attempt
    frames: Frames
    visits: Sequence[CapturedVisit]

    def later(self, shift_ns: int) -> "_RecordedAttempt":
        """The same at another time."""
        moved = [
            replace(
                v,
                arrived_ns=v.arrived_ns + shift_ns,
                from_ns=v.from_ns + shift_ns,
                to_ns=v.to_ns + shift_ns,
                frames=_later(v.frames, shift_ns),
            )
            for v in self.visits
        ]
        return replace(self, frames=_later(self.frames, shift_ns), visits=moved)


def frames(log: LogReader, attempts: Sequence[Attempt]) -> tuple[Frames, Annotations]:
    """All raw frames of the attempts in the order of time, and marks of their dwells.

    A simulation's time runs ahead of the clock, so that the next one may begin before the last has ended: it is moved
    behind it. Errors: UsageError when real attempts overlap in time on one node, so that marks could not part them.
    """
    ordered = sorted(attempts, key=lambda a: (a.started_ns, a.number))
    recorded = list(_apart([_recorded(log, attempt) for attempt in ordered]))
    joined = Frames.join([one.frames for one in recorded])
    joined = joined[np.argsort(joined.time_ns, kind="stable")]
    zero_ns = int(joined.time_ns[0]) if len(joined) else 0
    count = Counter(a.serial for a in attempts)
    made = tuple(
        mark.model_copy(
            update={
                "attempt": one.attempt.attempt if count[one.attempt.serial] > 1 else "",
                "simulated": stored_attempt.mark_of(one.attempt.software),
                "recipe": one.attempt.recipe_name,
            }
        )
        for one in recorded
        for mark in _marks(log, one, zero_ns)
    )
    return joined, Annotations(marks=made)


def _recorded(log: LogReader, attempt: Attempt) -> _RecordedAttempt:
    parts = log.frames(attempt)
    return _RecordedAttempt(attempt, Frames.join(parts), stored_visits(log.attempt(attempt)["visits"], parts))


def _apart(recorded: Sequence[_RecordedAttempt]) -> Iterator[_RecordedAttempt]:
    """The attempts, in the order in which they began, none of a node before the end of another of that node."""
    last: dict[int, tuple[int, Attempt]] = {}
    shift_ns = end_ns = 0
    for own in recorded:
        time_ns = own.frames.time_ns
        if not len(time_ns):
            yield own
            continue
        node, first_ns = own.attempt.node, int(time_ns.min())
        until_ns, other = last.get(node, (first_ns, own.attempt))
        if first_ns + shift_ns < until_ns:
            if not all(stored_attempt.is_simulated(a.software) for a in (own.attempt, other)):
                raise UsageError("attempts-overlap", first=other.attempt, second=own.attempt.attempt, node=node)
            shift_ns = end_ns + PAUSE_NS - first_ns  # units of one load go on sharing one clock
        now_ns = int(time_ns.max()) + shift_ns
        end_ns, last[node] = max(end_ns, now_ns), (now_ns, own.attempt)
        yield own.later(shift_ns) if shift_ns else own


def _later(frames: Frames, shift_ns: int) -> Frames:
    return replace(frames, time_ns=frames.time_ns + np.int64(shift_ns))


def _marks(log: LogReader, own: _RecordedAttempt, zero_ns: int) -> list[Annotation]:
    attempt = own.attempt
    _, _, layout = parse_recipe_and_product(*log.recipe_and_product(attempt))
    try:
        return annotate_visits(NestAssignment(attempt.serial, attempt.nest, attempt.node), own.visits, layout, zero_ns)
    except ValidationError as exc:
        raise UsageError("marks-serial-characters", serial=attempt.serial) from exc
