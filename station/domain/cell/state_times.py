"""How long the station was in each outer state and how often, from the changes that the log keeps."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from station.domain.cell.packml import Command, State, after_command, after_done


@dataclass(frozen=True, slots=True)
class StateTimes:
    """Present state since `since_s`, and what was before: seconds and entries of each state. Times on one clock."""

    state: State
    since_s: float
    seconds: Mapping[State, float]
    entries: Mapping[State, int]

    @staticmethod
    def begin(state: State, now_s: float) -> "StateTimes":
        """Nothing was before."""
        return StateTimes(state, now_s, {}, {state: 1})

    def command(self, command: Command, now_s: float) -> "StateTimes":
        """After a command. Errors: UsageError where the state does not take it."""
        return self._enter(after_command(self.state, command), now_s)

    def done(self, now_s: float) -> "StateTimes":
        """After the state's own work; a waiting state stays as it is."""
        following = after_done(self.state)
        return self if following is self.state else self._enter(following, now_s)

    def total_s(self, state: State, now_s: float) -> float:
        """Seconds in `state` up to now, the present stay included."""
        running = max(0.0, now_s - self.since_s) if state is self.state else 0.0
        return self.seconds.get(state, 0.0) + running

    def _enter(self, state: State, now_s: float) -> "StateTimes":
        # A clock that was set back gives a stay of no time, never a negative one.
        seconds = {**self.seconds, self.state: self.total_s(self.state, now_s)}
        entries = {**self.entries, state: self.entries.get(state, 0) + 1}
        return replace(self, state=state, since_s=now_s, seconds=seconds, entries=entries)


@dataclass(frozen=True, slots=True)
class Stay:
    """One stay in a state, s on the clock of the log."""

    state: State
    from_s: float
    until_s: float

    def within(self, from_s: float, until_s: float) -> float:
        """Seconds of it that lie in a span."""
        return max(0.0, min(self.until_s, until_s) - max(self.from_s, from_s))


def stays(changes: Iterable[tuple[float, State]], until_s: float) -> list[Stay]:
    """Stays from changes (instant, state entered) in their order; the last one lasts until `until_s`."""
    found: list[Stay] = []
    last: tuple[float, State] | None = None
    for at_s, state in changes:
        if last is not None:
            found.append(Stay(last[1], last[0], max(last[0], at_s)))
        last = at_s, state
    if last is not None:
        found.append(Stay(last[1], last[0], max(last[0], until_s)))
    return found
