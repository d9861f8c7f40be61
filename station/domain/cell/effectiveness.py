"""Overall equipment effectiveness (ISO 22400-2): availability · performance · quality of one shift."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from station.domain.cell.packml import State
from station.domain.cell.state_times import Stay

#: Nobody wanted the station to make anything: time that was not planned.
UNPLANNED = frozenset({State.STOPPED, State.STOPPING, State.RESETTING, State.IDLE})
#: The station makes units, or waits for those that the line owes it (a loss of the line's, not of the station's).
PRODUCING = frozenset({State.STARTING, State.EXECUTE, State.COMPLETING, State.COMPLETE})


@dataclass(frozen=True, slots=True)
class Made:
    """One finished attempt: when it ended, s, whether it passed, and whether it was the unit's first."""

    ended_s: float
    passed: bool
    first: bool


@dataclass(frozen=True, slots=True)
class Effectiveness:
    """One shift. planned_s, producing_s, held_s, suspended_s, aborted_s: seconds; ideal_s: time of a unit at best.

    availability: producing ÷ planned; performance: units · ideal ÷ producing; quality: units that passed at their
    first attempt ÷ units. NaN where nothing was planned, produced or made.
    """

    from_s: float
    until_s: float
    planned_s: float
    producing_s: float
    held_s: float
    suspended_s: float
    aborted_s: float
    units: int
    good: int
    ideal_s: float

    @property
    def availability(self) -> float:
        """Share of the planned time in which it produced."""
        return self.producing_s / self.planned_s if self.planned_s > 0 else float("nan")

    @property
    def performance(self) -> float:
        """Share of the ideal speed; above 1 where the ideal time of a unit is set too long."""
        return self.units * self.ideal_s / self.producing_s if self.producing_s > 0 else float("nan")

    @property
    def quality(self) -> float:
        """Share of the units that were good at once."""
        return self.good / self.units if self.units else float("nan")

    @property
    def oee(self) -> float:
        """The product of the three."""
        return self.availability * self.performance * self.quality


def by_shift(
    stays: Sequence[Stay], made: Iterable[Made], shift_s: float, offset_s: float, ideal_s: float
) -> list[Effectiveness]:
    """One entry a shift in which the station was in any state. shift_s: length; offset_s: when a shift begins, seconds
    after a multiple of shift_s since 1970 (UTC)."""
    if not stays:
        return []
    units = list(made)
    first = int((stays[0].from_s - offset_s) // shift_s)
    last = int((stays[-1].until_s - offset_s) // shift_s)
    return [
        _one(stays, units, k * shift_s + offset_s, (k + 1) * shift_s + offset_s, ideal_s)
        for k in range(first, last + 1)
        if any(s.within(k * shift_s + offset_s, (k + 1) * shift_s + offset_s) > 0 for s in stays)
    ]


def _one(stays: Sequence[Stay], made: Sequence[Made], from_s: float, until_s: float, ideal_s: float) -> Effectiveness:
    def seconds(*states: State) -> float:
        return sum(s.within(from_s, until_s) for s in stays if s.state in states)

    here = [m for m in made if from_s <= m.ended_s < until_s and m.first]
    return Effectiveness(
        from_s=from_s,
        until_s=until_s,
        planned_s=seconds(*(frozenset(State) - UNPLANNED)),
        producing_s=seconds(*PRODUCING),
        held_s=seconds(State.HOLDING, State.HELD, State.UNHOLDING),
        suspended_s=seconds(State.SUSPENDING, State.SUSPENDED, State.UNSUSPENDING),
        aborted_s=seconds(State.ABORTING, State.ABORTED, State.CLEARING),
        units=len(here),
        good=sum(m.passed for m in here),
        ideal_s=ideal_s,
    )
