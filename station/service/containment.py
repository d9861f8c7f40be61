"""Which units something touched, and how each of them stands now."""

from dataclasses import dataclass

from station.ports.log_reader import Attempt, LogReader, Query

#: Of so many units or fewer, each is looked up for how it stands now; of more, all attempts are read once.
_FEW = 2000


@dataclass(frozen=True, slots=True)
class TouchedUnit:
    """One unit: how often it was touched, when first and last, how the last of those attempts ended, and how its newest
    attempt of all ended: a unit that passed elsewhere afterwards may be let go."""

    serial: str
    attempts: int
    first_ns: int
    last_ns: int
    outcome: str
    now: str


def touched(log: LogReader, query: Query) -> list[TouchedUnit]:
    """Units of the attempts that the query names, by serial. Errors: LogError."""
    of_unit: dict[str, list[Attempt]] = {}
    for attempt in log.attempts(query):  # newest first
        of_unit.setdefault(attempt.serial, []).append(attempt)
    newest = _newest(log, set(of_unit))
    return [
        TouchedUnit(
            serial, len(found), found[-1].started_ns, found[0].started_ns, found[0].outcome or "", newest[serial]
        )
        for serial, found in sorted(of_unit.items())
    ]


def _newest(log: LogReader, serials: set[str]) -> dict[str, str]:
    """How the newest attempt of each serial ended; '' while it runs."""
    if len(serials) <= _FEW:
        return {serial: log.attempts(Query(serial=serial), 1)[0].outcome or "" for serial in serials}
    newest: dict[str, str] = {}
    for attempt in log.attempts(Query()):
        if attempt.serial in serials and attempt.serial not in newest:
            newest[attempt.serial] = attempt.outcome or ""
    return newest
