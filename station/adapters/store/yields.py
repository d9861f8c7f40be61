"""First-pass and final yield, and what happened each day, counted from rows: every attempt is one."""

import sqlite3
from dataclasses import dataclass

from station.adapters.store.search import Query
from station.errors import UsageError

#: What a yield may be grouped by, as SQL.
GROUPS = {
    "all": "''",
    "station": "a.station",
    "nest": "a.station || '/' || a.nest",
    "recipe": "a.recipe_name || '/' || a.recipe_version",
    "lot": "a.lot",
    "operator": "a.operator",
    "day": "date(a.started_ns / 1000000000, 'unixepoch')",
}
#: Several groupings in one walk through the log: their names, parted by SEPARATOR, in the order of CELL.
CELL, SEPARATOR = ("station", "nest", "recipe", "day"), "\x1f"
GROUPS["cell"] = f" || '{SEPARATOR}' || ".join(GROUPS[name] for name in CELL)


@dataclass(frozen=True, slots=True)
class Yield:
    """Counts of one group. attempts: finished ones; units: serial numbers whose first attempt lies in the group.

    first_pass: of those, how many passed at their first attempt, whatever stopped the others. final_pass, final:
    serials whose last attempt lies in the group, and how many of those passed it.
    """

    group: str
    attempts: int
    passed: int
    failed: int
    errors: int
    aborted: int
    interrupted: int
    units: int
    first_pass: int
    final: int
    final_pass: int
    mean_duration_s: float

    @property
    def first_pass_yield(self) -> float:
        """Share of units that passed at once; NaN where there is none."""
        return self.first_pass / self.units if self.units else float("nan")

    @property
    def final_yield(self) -> float:
        """Share of units whose last attempt passed; NaN where there is none."""
        return self.final_pass / self.final if self.final else float("nan")


_OTHER = (
    "SELECT 1 FROM attempt b INDEXED BY attempt_serial "
    "WHERE b.serial = a.serial AND b.recipe_name = a.recipe_name AND b.seq"
)


def yields(db: sqlite3.Connection, query: Query, by: str = "all") -> list[Yield]:
    """Yields of the attempts that the query names, by group, in the order of the groups' names. Errors: UsageError."""
    if by not in GROUPS:
        raise UsageError(f"there is no yield by {by!r}; use one of {', '.join(GROUPS)}")
    where, parameters = query.where()
    first, last = f"NOT EXISTS ({_OTHER} < a.seq)", f"NOT EXISTS ({_OTHER} > a.seq)"
    outcomes = ", ".join(f"sum(outcome = '{o}')" for o in ("PASS", "FAIL", "ERROR", "ABORTED", "INTERRUPTED"))
    rows = db.execute(
        f"""WITH picked AS (SELECT {GROUPS[by]} AS g, f.outcome, f.ended_ns - a.started_ns AS took,
                {first} AS first, {last} AS last
            FROM attempt a JOIN finish f ON f.attempt = a.seq WHERE {where})
        SELECT g, count(*), {outcomes}, sum(first), sum(first AND outcome = 'PASS'), sum(last),
            sum(last AND outcome = 'PASS'), avg(took) / 1e9
        FROM picked GROUP BY g ORDER BY g""",
        parameters,
    )
    return [Yield(*row) for row in rows]
