"""How a text writes its table: delimiter, decimal mark, comments, header, line of units."""

import csv
import re
from collections import Counter
from dataclasses import dataclass

from station.adapters.recordings.limits import check_column_names
from station.domain.recognition import time_column
from station.domain.recognition.axis_names import are_lettered
from station.domain.recognition.quantities import QUANTITIES, canonical
from station.errors import SamplesError

_NUMBER = re.compile(r"^[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$|^[+-]?(nan|inf)$|^0x[0-9a-f]{1,8}$", re.IGNORECASE)
#: Thousands set apart by the mark that is not the decimal one.
_THOUSANDS = {
    ".": re.compile(r"^[+-]?\d{1,3}(,\d{3})+(\.\d*)?$"),
    ",": re.compile(r"^[+-]?\d{1,3}(\.\d{3})+(,\d*)?$"),
}
#: And as Switzerland does, and space.
_APOSTROPHES = re.compile(r"^[+-]?\d{1,3}(['\u2019\u202f\xa0]\d{3})+([.,]\d*)?$")
_COMMENT = re.compile(r"^\s*(#|%|//|!)")
#: A comment that says of itself that it names the columns.
_CALLED = re.compile(r"^\s*[#%/!]+\s*(?:columns?|fields?|header)\s*[:=]\s*(?P<names>.+)$", re.IGNORECASE)
_RATE = re.compile(r"(?:sampl\w*|update|data)[ _-]*(?:rate|freq\w*)\D{0,12}?(\d+(?:\.\d+)?)", re.IGNORECASE)
_RATE_KEY = re.compile(
    r"^\W*(?:fs|f_s|odr|rate|frequency|freq)(?:[ _]*\(?hz\)?)?\W{1,4}(\d+(?:\.\d+)?)\W*(?:hz)?\W*$",
    re.IGNORECASE,
)
_UNIT = re.compile(r"[\[(<]([^\])>]*)[\])>]")
_NAME = r"\"?([A-Za-z]\w*)\"?(?:\s*[:=]\s*|\s+(?=[-+.\d]))"
_KEYED = re.compile(rf"^[\s{{]*(?:{_NAME}[-+]?[\d.]+(?:[eE][-+]?\d+)?[,;\s]*){{3,}}\}}?[\s,]*$")
_KEY = re.compile(rf"(?<!\w){_NAME}")
#: Lines that show the dialect, the fewest of names and values, and characters of a remark that may state the rate.
HEAD, LEAST_KEYED, LONGEST_REMARK = 400, 8, 300
#: Lines of a header at the most: devices, names, kinds and units.
MOST_HEADER = 4
#: Longer lines with quoted cells are no rows.
LONGEST_QUOTED = 100_000
#: Stamps of the present day, s.
SINCE_1970_S = (5e8, 5e9)
#: A text is of one column where this share of its lines is one number.
MOSTLY = 0.9
#: Rows end with a delimiter when this share does.
CLOSED = 0.95
DELIMITERS = (";", "\t", ",", "|", " ")


@dataclass(frozen=True, slots=True)
class Dialect:
    """delimiter (a blank: any white space); decimal: `.` or `,`; first: index of the first line of data; names, units
    (k) or no names; columns k; rate_hz: as a comment states it; closed: whether a delimiter ends each row."""

    delimiter: str
    decimal: str
    first: int
    names: tuple[str, ...] | None
    units: tuple[str, ...]
    columns: int
    rate_hz: float | None
    closed: bool = True


def recognise(file: str, lines: list[str]) -> Dialect:
    """The dialect of a text by its first lines. Errors: SamplesError where they hold no table of numbers."""
    content = [(i, line) for i, line in enumerate(lines) if line.strip() and not is_comment(line)]
    scored = [(*score(content, delimiter), delimiter) for delimiter in DELIMITERS]
    best, columns, delimiter = max(scored, key=lambda s: (round(s[0], 2), s[1]))
    if best < 0.3 and (name := _only_column(content)) is not None:
        raise SamplesError("no-three-axes", file=file, columns=name)
    if best < 0.3:
        raise SamplesError("no-table-of-numbers", file=file)
    closed = _closed(content, delimiter)
    rows = [(i, split(line, delimiter, closed=closed)) for i, line in content]
    usual = _numeric_share([cells for _, cells in rows if len(cells) == columns][-50:])
    like_rows = (i for i, cells in rows if len(cells) == columns and _numeric_share([cells]) >= 0.75 * usual)
    # A title with empty cells behind it is no row.
    first = next((i for i in like_rows if any(map(is_number, split(lines[i], delimiter)))), None)
    if first is None:
        raise SamplesError("no-table-of-numbers", file=file)
    data = [cells for i, cells in rows if i >= first]
    decimal = _decimal([c for cells in data for c in cells if _NUMBER.match(c)], delimiter)
    names, units = _header(file, lines[:first], delimiter, columns, rows=data[:HEAD])
    head = [line[:LONGEST_REMARK] for line in lines[:first]]
    stated = [m for line in head if (m := _RATE.search(line) or _RATE_KEY.match(line))]
    return Dialect(delimiter, decimal, first, names, units, columns, float(stated[0][1]) if stated else None, closed)


def _only_column(content: list[tuple[int, str]]) -> str | None:
    """The name of the column where each line is one number; None where it is not so."""
    if not content or sum(is_number(line.strip()) for line in _tail(content)) < MOSTLY * len(_tail(content)):
        return None
    first = content[0][1].strip()
    return "column 0" if is_number(first) else first[:LONGEST_REMARK]


def _decimal(numbers: list[str], delimiter: str) -> str:
    """The decimal mark; a comma in quoted cells between commas is one only where no cell has a point."""
    commas = any("," in n for n in numbers)
    return "," if commas and (delimiter != "," or not any("." in n for n in numbers)) else "."


def without_keys(lines: list[str]) -> list[str]:
    """Lines of `ax:0.1, ay:0.2` or `ax 0.1 ay 0.2` as a header and rows; other lines as they are."""
    head = [line for line in lines[:HEAD] if line.strip()]
    keyed = [line for line in head if _KEYED.match(line)]
    if len(keyed) < 0.8 * max(len(head), 1) or len(keyed) < LEAST_KEYED:
        return lines
    names = _KEY.findall(keyed[-1])
    if len(set(names)) < len(names) or _KEY.findall(keyed[0]) != names:
        return lines
    rows = [_KEY.sub(" ", line) for line in lines if _KEYED.match(line)]
    return [" ".join(names), *(re.sub(r"[,;\s{}]+", " ", row) for row in rows)]


def without_start(lines: list[str]) -> list[str]:
    """Lines without two that hold the start, in seconds since 1970, and the rate of every column; the rate is kept."""
    if len(lines) < HEAD:
        return lines
    start, rate = ({c.strip() for c in line.split(",")} for line in lines[:2])
    if len(start) != 1 or len(rate) != 1 or not is_number(rate_hz := rate.pop()) or not is_number(begun := start.pop()):
        return lines
    since_1970 = SINCE_1970_S[0] < cell_value(begun, ".") < SINCE_1970_S[1]
    return [f"# rate: {rate_hz}", *lines[2:]] if since_1970 and lines[0].count(",") else lines


def is_comment(line: str) -> bool:
    """Whether a line is a remark and no row."""
    return _COMMENT.match(line) is not None


def split(line: str, delimiter: str, *, closed: bool = True) -> list[str]:
    """The cells of a line; closed: a delimiter at its end begins no cell."""
    if delimiter == " ":
        return line.split()
    plain = line.rstrip("\r\n")
    parts = (
        next(csv.reader([plain], delimiter=delimiter))
        if '"' in plain and len(plain) < LONGEST_QUOTED
        else plain.split(delimiter)
    )
    cells = [c.strip().strip('"') for c in parts]
    return cells[:-1] if closed and len(cells) > 1 and not cells[-1] else cells


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with either decimal mark."""
    return any(mark.match(cell) for mark in (_NUMBER, *_THOUSANDS.values(), _APOSTROPHES))


def cell_value(cell: str, decimal: str) -> float:
    """What a cell says; NaN where it is no number."""
    plain = cell.strip()
    if plain[:2].lower() == "0x" and _NUMBER.match(plain):
        return float(int(plain, 16))
    if _APOSTROPHES.match(plain):
        plain = re.sub(r"['\u2019\u202f\xa0]", "", plain)
    if _THOUSANDS[decimal].match(plain):
        plain = plain.replace("." if decimal == "," else ",", "")
    plain = plain.replace(decimal, ".")
    return float(plain) if _NUMBER.match(plain) and "," not in plain else float("nan")


def score(lines: list[tuple[int, str]], delimiter: str) -> tuple[float, int]:
    """How much of a text is rows of numbers by a delimiter (0 … 1), and how many cells they have."""
    tail = _tail(lines)
    closed = _closed(lines, delimiter)
    rows = [split(line, delimiter, closed=closed) for line in tail]
    ((columns, times),) = Counter(len(cells) for cells in rows).most_common(1) or ((0, 0),)
    if columns < 2:
        return 0.0, columns
    regular = [cells for cells in rows if len(cells) == columns]
    return times / len(rows) * _numeric_share(regular) ** 0.5, columns


def _tail(lines: list[tuple[int, str]]) -> list[str]:
    """The second half, which has rows and no header."""
    return [line for _, line in lines[len(lines) // 2 :] or lines]


def _closed(lines: list[tuple[int, str]], delimiter: str) -> bool:
    """Whether a delimiter ends each row. Where it ends some, or the header names one column more, the last cell is
    empty."""
    tail = _tail(lines)
    ending = [line for line in tail if line.rstrip("\r\n ").endswith(delimiter)]
    if len(ending) <= CLOSED * len(tail):
        return False
    cells = len(split(ending[-1], delimiter, closed=False))
    heads = (split(line, delimiter, closed=False) for _, line in lines[: len(lines) - len(tail)])
    return not any(len(head) == cells and head[-1] and not any(map(is_number, head)) for head in heads)


def _numeric_share(rows: list[list[str]]) -> float:
    cells = [c for row in rows for c in row]
    return sum(is_number(c) or not c for c in cells) / max(len(cells), 1)


def _header(
    file: str, lines: list[str], delimiter: str, columns: int, rows: list[list[str]]
) -> tuple[tuple[str, ...] | None, tuple[str, ...]]:
    """Names and units of the columns by the lines above the data; a comment may be the header."""
    above = _called_header(lines) or [line for line in lines if line.strip()][-MOST_HEADER:]
    cut = [split(_COMMENT.sub("", line), delimiter) for line in above if not _is_prose(line, delimiter)]
    heads = [cells for cells in cut if len(cells) == columns and not any(is_number(c) for c in cells)]
    if not heads and cut:
        heads = _of_other_length(cut[-1], columns, rows)
    if not heads:
        return None, ("",) * columns
    check_column_names(file, (name for cells in heads for name in cells))
    names, more = _names_and_units(heads)
    units = [unit.strip() or _in_brackets(name) for name, unit in zip(names, more or [""] * columns, strict=True)]
    plain = [_UNIT.sub("", n).strip() if _in_brackets(n) else n for n in names]
    if len(set(plain)) < len(plain):
        plain = names
    return tuple(n or f"column {i}" for i, n in enumerate(plain)), tuple(u.strip(" []()") for u in units)


def _is_prose(line: str, delimiter: str) -> bool:
    """Whether a comment beside numbers that blanks separate is a sentence: it names no axes, time or unit, and by
    chance it has as many words as there are columns."""
    if delimiter != " " or not is_comment(line):
        return False
    words = split(_COMMENT.sub("", line), delimiter)
    of_unit = any(canonical(word, q) for word in words for q in QUANTITIES.values())
    return not (are_lettered(words) or of_unit or any(time_column.NAMES.search(word) for word in words))


def _names_and_units(heads: list[list[str]]) -> tuple[list[str], list[str]]:
    """Of the lines of a header the names, behind those of their devices where they come several times, and the units;
    a line of one word for all columns says nothing of them."""
    telling = [cells for cells in heads if len(set(cells)) > 1] or heads[-1:]
    *before, last = telling
    units = last if before and _are_units(last) and not are_lettered(last) else []
    names, *devices = reversed(before) if units else reversed(telling)
    for device in devices:
        if len(set(names)) < len(names):
            names = [f"{group} {name}".strip() for group, name in zip(device, names, strict=True)]
    return names, units


def _called_header(lines: list[str]) -> list[str]:
    """The comment that says of itself that it names the columns, without that word; nothing where none does."""
    found = [m for line in lines if (m := _CALLED.match(line))]
    return [found[-1]["names"]] if found else []


def _of_other_length(cells: list[str], columns: int, rows: list[list[str]]) -> list[list[str]]:
    """A header that names three axes, with some cells more or fewer than the rows; a row's own name is without one, as
    R writes it."""
    if any(is_number(c) for c in cells) or len(cells) < columns / 2 or not are_lettered(cells):
        return []
    numbered = all(row[0] == str(i + 1) for i, row in enumerate(rows) if row)
    first = [""] if len(cells) == columns - 1 and numbered else []
    return [[*first, *cells, *[""] * columns][:columns]]


def _in_brackets(name: str) -> str:
    """A unit in brackets; an index in brackets is none."""
    found = _UNIT.search(name)
    return "" if found is None or found[1].strip().isdigit() else found[1].strip()


def _are_units(cells: list[str]) -> bool:
    """Whether a second line of a header holds units: short, and none longer than a unit is."""
    return all(len(c.strip(" []()")) <= 8 for c in cells)
