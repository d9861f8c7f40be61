"""Where a row of a samples table is, as messages name it."""

from station.domain.core.types import SampleTable


def where_is(table: SampleTable, row: int) -> dict[str, str | int]:
    """Unit, run, visit and position of a row."""
    return {
        "serial": table.unit.names[table.unit.code[row]],
        "run": int(table.run[row]),
        "visit": int(table.visit[row]),
        "position": table.position.names[table.position.code[row]],
    }
