"""First-pass and final yield, and what happened each day, counted from rows: every attempt is one."""

import sqlite3

from station.adapters.store.search import where
from station.domain.records.tables import YIELD_GROUPS
from station.errors import UsageError
from station.ports.log_reader import YIELD_CELL, YIELD_SEPARATOR, Query, Yield

#: What a yield may be grouped by, as SQL.
GROUPS = {
    **YIELD_GROUPS,
    "day": "date(a.started_ns / 1000000000, 'unixepoch')",
}
#: Several groupings in one walk through the log: their names, parted by YIELD_SEPARATOR, in the order of YIELD_CELL.
GROUPS["cell"] = f" || '{YIELD_SEPARATOR}' || ".join(GROUPS[name] for name in YIELD_CELL)


_OTHER = (
    "SELECT 1 FROM attempt b INDEXED BY attempt_serial "
    "WHERE b.serial = a.serial AND b.recipe_name = a.recipe_name AND b.seq"
)


def yields(db: sqlite3.Connection, query: Query, by: str = "all") -> list[Yield]:
    """Yields of the attempts that the query names, by group, in the order of the groups' names. Errors: UsageError."""
    if by not in GROUPS:
        raise UsageError("yield-unknown-group", group=by, groups=tuple(GROUPS))
    condition, parameters = where(query)
    first, last = f"NOT EXISTS ({_OTHER} < a.seq)", f"NOT EXISTS ({_OTHER} > a.seq)"
    outcomes = ", ".join(f"sum(outcome = '{o}')" for o in ("PASS", "FAIL", "ERROR", "ABORTED", "INTERRUPTED"))
    rows = db.execute(
        f"""WITH picked AS (SELECT {GROUPS[by]} AS g, f.outcome, f.ended_ns - a.started_ns AS took,
                {first} AS first, {last} AS last
            FROM attempt a JOIN finish f ON f.attempt = a.seq WHERE {condition})
        SELECT g, count(*), {outcomes}, sum(first), sum(first AND outcome = 'PASS'), sum(last),
            sum(last AND outcome = 'PASS'), avg(took) / 1e9
        FROM picked GROUP BY g ORDER BY g""",
        parameters,
    )
    return [Yield(*row) for row in rows]
