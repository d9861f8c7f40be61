"""JSON and JSON lines: records, columns or rows, nested as they may be → lines of tables."""

import json
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

#: Longer text is no recording by JSON; deeper values are no readings; longer lists are no cells.
MOST_CHARACTERS, DEEPEST, WIDEST = 100_000_000, 6, 16
#: Fewer records are no table; more kinds of records than these are none.
LEAST_ROWS, MOST_KINDS = 9, 40
#: A text that has so few values, in turn, tells kinds of records.
FEW_WORDS = 20

Record = dict[str, Any]


def json_tables(text: str) -> list[list[str]]:
    """Lines, the first a header, of each table that a JSON text holds; none where it is no JSON."""
    if len(text) > MOST_CHARACTERS or not text.lstrip("\ufeff \t\r\n").startswith(("{", "[")):
        return []
    try:
        records = [dict(_flat(one)) for one in _records(_parsed(text))]
    except (RecursionError, ValueError):
        return []
    kinds: dict[tuple[str, ...], list[Record]] = {}
    words = _words(records)
    for record in records:
        kinds.setdefault((*record, *(str(record.get(w, "")) for w in words)), []).append(record)
    if len(kinds) > MOST_KINDS:
        return []
    return [_lines(rows, words) for rows in kinds.values() if len(rows) >= LEAST_ROWS]


def _parsed(text: str) -> Any:
    """The value of the text, or the values of its lines."""
    try:
        return json.loads(text)
    except ValueError:
        lines = [line.strip().rstrip(",") for line in text.splitlines()]
        whole = [line for line in lines if line[:1] in ("{", "[") and line[-1:] in ("}", "]")]
        if len(whole) < 0.8 * sum(map(bool, lines)):
            raise
        return [json.loads(line) for line in whole]


def _records(value: Any) -> list[Record]:
    """What is a row each: the items of the longest list, or the places of lists of one length."""
    if isinstance(value, list):
        return [v if isinstance(v, dict) else {"": v} for v in value if isinstance(v, dict | list)]
    lists = dict(_lists(value))
    if not lists:
        return []
    ((length, _),) = Counter(map(len, lists.values())).most_common(1)
    columns = {name: items for name, items in lists.items() if len(items) == length}
    if len(columns) == 1 and isinstance(next(iter(columns.values()))[0], dict):
        return _records(next(iter(columns.values())))
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _lists(value: Any, path: str = "", depth: int = 0) -> Iterator[tuple[str, list[Any]]]:
    """The lists that are long enough to be columns, by their path."""
    if isinstance(value, list) and len(value) >= LEAST_ROWS:
        yield path, value
    elif isinstance(value, dict) and depth < DEEPEST:
        for key, inner in value.items():
            yield from _lists(inner, f"{path}.{key}".strip("."), depth + 1)


def _flat(value: Any, path: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """Numbers and texts of one record by their path."""
    if isinstance(value, dict) and depth < DEEPEST:
        for key, inner in value.items():
            yield from _flat(inner, f"{path}.{key}".strip("."), depth + 1)
    elif isinstance(value, list) and len(value) <= WIDEST and depth < DEEPEST:
        for i, inner in enumerate(value):
            yield from _flat(inner, f"{path}_{i}".strip("_") if path else f"column {i}", depth + 1)
    elif value is None or isinstance(value, int | float | str):
        yield path, value


def _words(records: list[Record]) -> list[str]:
    """Fields whose few words take turns: kinds of records."""
    found = []
    for name in records[0] if records else ():
        words = [r[name] for r in records if isinstance(r.get(name), str)]
        changes = sum(a != b for a, b in pairwise(words))
        if 1 < len(set(words)) <= FEW_WORDS and changes > 0.1 * len(words):
            found.append(name)
    return found


def _lines(rows: list[Record], words: list[str]) -> list[str]:
    names = [n for n in rows[0] if n not in words]
    kind = " ".join(str(rows[0].get(w, "")) for w in words)
    header = [f"{kind} {n}".strip() if kind and n in ("x", "y", "z") else n for n in names]
    return [";".join(_cell(n) for n in header), *(";".join(_cell(row.get(n)) for n in names) for row in rows)]


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(int(value))
    return value.replace(";", " ").replace("\n", " ") if isinstance(value, str) else repr(value)
