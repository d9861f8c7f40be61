"""Whether the log's indices lead where they should: one that leads astray hides an attempt from every question.

The schema's definitions cannot show it (the pages of two indices may have been exchanged), and SQLite's full check
reads the whole file. So each index is tried with its first and its last entry and with some rows of its table:
milliseconds at every start. What is taken out of an index one by one, `station audit --verify` finds.
"""

import re
import sqlite3

from station.adapters.store.schema import INDICES

_FORM = re.compile(r"(?P<name>\w+) ON (?P<table>\w+)\((?P<columns>.+?)\)(?: WHERE (?P<only>[^)]+))?$")
#: Rows of its table by which an index is tried.
_TRIED = 10


def misleading_indices(db: sqlite3.Connection) -> list[str]:
    """Names of those that lead astray. Errors: sqlite3.DatabaseError where the file is damaged."""
    return [match["name"] for text in INDICES if (match := _FORM.match(text)) and not _leads_right(db, match)]


def _leads_right(db: sqlite3.Connection, index: re.Match[str]) -> bool:
    name, table, columns = index["name"], index["table"], index["columns"]
    only = index["only"] or "1"
    last = ", ".join(f"{column} DESC" for column in _split(columns))
    by_index = f"SELECT seq, {columns} FROM {table} INDEXED BY {name} WHERE {only} ORDER BY"
    entries = [*db.execute(f"{by_index} {columns} LIMIT 1"), *db.execute(f"{by_index} {last} LIMIT 1")]
    by_table = f"SELECT seq, {columns} FROM {table} NOT INDEXED WHERE {only}"
    if any(db.execute(f"{by_table} AND seq = ?", entry[:1]).fetchone() != entry for entry in entries):
        return False
    same = " AND ".join(f"{column} IS ?" for column in _split(columns))
    found = f"SELECT 1 FROM {table} INDEXED BY {name} WHERE {only} AND {same} AND seq = ?"
    rows = db.execute(f"{by_table} ORDER BY seq DESC LIMIT {_TRIED}").fetchall()
    return all(db.execute(found, (*row[1:], row[0])).fetchone() for row in rows)


def _split(columns: str) -> list[str]:
    """The columns of an index; a comma inside brackets parts none."""
    return re.split(r", (?![^(]*\))", columns)
