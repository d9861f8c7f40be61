"""The log's tables of evidence and their sealed columns, whatever database holds them."""

from collections.abc import Mapping
from dataclasses import dataclass

from station.domain.records.chain import Value

#: Columns in the order in which they are sealed: `name:type`, the type i, f, s or b (chain.canonical), ? where it may
#: be null. A later schema adds columns at the end.
_TABLES = {
    "document": "sha256:s kind:s text:s",
    "attempt": "id:s serial:s station:s nest:s node:i lot:s recipe_name:s recipe_version:i recipe_hash:s recipe:i? "
    "product:i? config_hash:s software:s operator:s started_ns:i",
    "event": "attempt:i? at_ns:i kind:s detail:s",
    "visit": "attempt:i run:i visit:i position:s seating:s kind:s arrived_ns:i left_ns:i frame_count:i "
    "frames_sha256:s statistics:s",
    "write": "attempt:i at_ns:i object:i sub:i name:s stage:s value:f? old:b? written:b read_back:b?",
    "result": "attempt:i at_ns:i name:s document:s",
    "finish": "attempt:i outcome:s ended_ns:i",
    "archive": "attempt:i visits:i data:b",
}


@dataclass(frozen=True, slots=True)
class Column:
    """One sealed column of a table."""

    name: str
    type: type
    required: bool


def _columns(text: str) -> tuple[Column, ...]:
    types = {"i": int, "f": float, "s": str, "b": bytes}
    found = []
    for part in text.split():
        name, _, tag = part.partition(":")
        found.append(Column(name, types[tag[0]], not tag.endswith("?")))
    return tuple(found)


TABLES: dict[str, tuple[Column, ...]] = {table: _columns(text) for table, text in _TABLES.items()}

#: Names alone.
COLUMNS: dict[str, tuple[str, ...]] = {table: tuple(c.name for c in columns) for table, columns in TABLES.items()}

#: Of a record without nulls, and of any: the types of its values.
_TYPES = {table: tuple(c.type for c in columns) for table, columns in TABLES.items()}
_MAY_BE_NULL = {table: tuple(not c.required for c in columns) for table, columns in TABLES.items()}

#: What a signed 64-bit column holds.
_MOST = 2**63


def row_of(table: str, values: dict[str, Value]) -> tuple[Value, ...] | None:
    """The values in the order of the table's columns; None where this version knows no such record: another table,
    a further column, another type, a missing value, or what no database holds (NUL in a text, more than 64 bits)."""
    names = COLUMNS.get(table)
    if names is None:
        return None
    if tuple(values) == names:
        row = tuple(values.values())
        known = tuple(map(type, row)) == _TYPES[table]
    else:
        row = tuple(map(values.get, names))
        known = list(values) == [n for n, v in zip(names, row, strict=True) if v is not None] and all(
            map(_fits, row, _TYPES[table], _MAY_BE_NULL[table])
        )
    return row if known and all(map(_storable, row)) else None


def _fits(value: Value, kind: type, may_be_null: bool) -> bool:
    return may_be_null if value is None else type(value) is kind


def _storable(value: Value) -> bool:
    if type(value) is int:
        return -_MOST <= value < _MOST
    return "\x00" not in value if type(value) is str else True


#: Table → its time, and what a new record in it is about, in SQL that SQLite and PostgreSQL read; the table is `t`.
TIME_AND_DETAIL: Mapping[str, tuple[str, str]] = {
    "attempt": ("t.started_ns", "t.serial"),
    "event": ("t.at_ns", "t.kind"),
    "visit": ("t.left_ns", "t.kind || ' ' || t.position"),
    "write": ("t.at_ns", "t.stage || ' ' || t.name"),
    "result": ("t.at_ns", "t.name"),
    "finish": ("t.ended_ns", "t.outcome"),
}

#: What yields may be grouped by besides the day, in SQL that SQLite and PostgreSQL read; the attempt is `a`.
YIELD_GROUPS: Mapping[str, str] = {
    "all": "''",
    "station": "a.station",
    "nest": "a.station || '/' || a.nest",
    "recipe": "a.recipe_name || '/' || a.recipe_version",
    "lot": "a.lot",
    "operator": "a.operator",
}
