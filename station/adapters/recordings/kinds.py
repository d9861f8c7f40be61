"""Lines of several kinds, each named by a word: logs in which every sensor has rows of its own."""

import re
from collections import Counter, defaultdict
from itertools import pairwise

from station.adapters.recordings import dialect

#: A word that is the same, and not alone, in a column which changes this often from row to row tells kinds of rows.
OFTEN, MOST_KINDS, LEAST_ROWS, LAST_PLACE = 0.1, 100, 20, 3
_WORD = re.compile(r"^[A-Za-z_]\w*$")
#: `Acceleration X: 0.1, Y: 0.2, Z: 9.8 m/s^2`, perhaps behind the time at which a terminal received it.
_SPOKEN = re.compile(
    r"^(?:(?P<time>[\d:.,]+)\s*->\s*)?(?P<kind>[A-Za-z_][\w ]{0,40}?)(?:\s*[\[(](?P<before>[^\[\]()]{1,16})[\])])?\W*"
    r"\b[xX]\s*[:=]\s*(?P<x>[-+.\deE]+)[,;\s]+"
    r"[yY]\s*[:=]\s*(?P<y>[-+.\deE]+)[,;\s]+[zZ]\s*[:=]\s*(?P<z>[-+.\deE]+)\s*(?P<unit>\S{0,12})\s*$"
)
#: A line of an ArduPilot log that names the columns of a kind: FMT, type, length, name, format, columns.
FORMAT, FORMAT_NAME, FORMAT_COLUMNS = "FMT", 3, 5
#: A column of such a kind that tells which of several sensors a row is of.
INSTANCE = "I"


def apart(lines: list[str]) -> list[list[str]]:
    """The lines of each kind, with a header of its own; all lines where they are of one kind."""
    spoken = _spoken(lines)
    if spoken:
        return spoken
    # Logs begin with long lists of formats and settings; how rows follow each other shows in their middle.
    middle = lines[len(lines) // 2 :][: dialect.HEAD]
    some = [line for line in middle if line.strip() and not dialect.is_comment(line)]
    for delimiter in (",", ";", "\t"):
        rows = [dialect.split(line, delimiter) for line in some]
        place = _place_of_kinds(rows)
        if place is not None:
            return _by_kind(lines, delimiter, place)
    return [lines]


def _spoken(lines: list[str]) -> list[list[str]]:
    """Tables of the kinds of which lines speak; none where most lines speak of nothing."""
    filled = [line for line in lines[: dialect.HEAD] if line.strip()]
    if len(filled) < LEAST_ROWS or sum(_SPOKEN.match(line) is not None for line in filled) < 0.3 * len(filled):
        return []
    tables: dict[str, list[str]] = {}
    for line in lines:
        if (found := _SPOKEN.match(line)) is None:
            continue
        kind, stamp, unit = found["kind"].strip(), found["time"], found["before"] or found["unit"]
        header = ([] if stamp is None else ["time"]) + [f"{kind} {a} [{unit}]" for a in "xyz"]
        rows = tables.setdefault(kind, [";".join(header)])
        rows.append(";".join(([] if stamp is None else [stamp]) + [found[a] for a in "xyz"]))
    return [rows for rows in tables.values() if len(rows) >= LEAST_ROWS]


def _place_of_kinds(rows: list[list[str]]) -> int | None:
    """The column whose words tell kinds of rows; None where all rows are of one kind, or words last as labels do."""
    for place in range(LAST_PLACE):
        words = [row[place] for row in rows if len(row) > place + LAST_PLACE and _WORD.match(row[place])]
        kinds = Counter(words)
        common = [kind for kind, times in kinds.items() if times >= LEAST_ROWS]
        if not common or not 2 <= len(kinds) <= MOST_KINDS or len(words) < 0.9 * len(rows):
            continue
        changes = sum(a != b for a, b in pairwise(words))
        if changes > OFTEN * len(words):
            return place
    return None


def _by_kind(lines: list[str], delimiter: str, place: int) -> list[list[str]]:
    """Lines (a header and rows without the kind) of each kind that has rows of numbers."""
    names: dict[str, list[str]] = {}
    rows: dict[tuple[str, str], list[list[str]]] = defaultdict(list)
    shared: list[str] | None = None
    for line in lines:
        cells = dialect.split(line, delimiter)
        if len(cells) <= place or dialect.is_comment(line):
            continue
        rest = cells[:place] + cells[place + 1 :]
        if place == 0 and cells[0] == FORMAT and len(cells) > FORMAT_COLUMNS:
            names[cells[FORMAT_NAME]] = cells[FORMAT_COLUMNS:]
        elif any(map(dialect.is_number, cells)):
            named = dict(zip(names.get(cells[place], ()), rest, strict=False))
            rows[cells[place], named.get(INSTANCE, "")].append(rest)
        elif shared is None:
            shared = rest
    tables = [
        _with_header(own, names.get(kind) or _named_after(kind, shared), delimiter)
        for (kind, _), own in rows.items()
        if len(own) >= LEAST_ROWS
    ]
    return tables or [lines]


def _named_after(kind: str, shared: list[str] | None) -> list[str]:
    return [f"{kind} {n}" if n.lower() in ("x", "y", "z") else n for n in shared or ()]


def _with_header(rows: list[list[str]], header: list[str], delimiter: str) -> list[str]:
    ((usual, _),) = Counter(map(len, rows)).most_common(1)
    head = [delimiter.join(header)] if len(header) == usual else []
    return [*head, *(delimiter.join(row) for row in rows)]
