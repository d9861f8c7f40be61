"""Lines whose numbers stand among words, arrows and brackets, all in one pattern: lines of a table."""

import re
from collections import Counter
from itertools import pairwise

from station.adapters.recordings import dialect, record_lines, stamps
from station.domain.recognition import axis_names

#: A time of day, perhaps behind a date; and a number that is no part of a word, unless its unit follows.
_VALUE = re.compile(
    r"(?P<clock>(?:\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}[T ])?\d{1,2}:\d{2}:\d{2}(?:[.,]\d+)?"
    r"|(?:19|20)\d\d-\d\d-\d\d[-_T ]\d\d-\d\d-\d\d(?!\d))"
    r"|(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?=(?:m|mm|cm|km|s|ms|us|ns|g|mg|dps|uT|nT|hPa|V|mV)?(?!\w))"
)
_CHECKSUM = re.compile(r"\*[0-9A-Fa-f]{2}\s*$")
_NAME = re.compile(r"([A-Za-z_]\w*)\W{0,2}[:=]\W{0,2}$")
_CLOCK, _NUMBER = "@", "#"
_BRACKETED = re.compile(r"((?:[A-Za-z_]\w* )?[A-Za-z_]\w*)\s*[:=]\s*[\[({]\s*#[\s,]+#[\s,]+#\s*[\])}]")
#: `GYRO: X=#, Y=#, Z=#`, the unit perhaps behind the name.
_GROUPED = re.compile(
    r"([A-Za-z_]\w*)(?:\s?[\[(][^\[\]()]{0,12}[\])])?\s*:\s*x\s*[=:]\s*#[\w\s,;]*?\by\s*[=:]\s*#[\w\s,;]*?\bz\s*[=:]\s*#",
    re.IGNORECASE,
)
#: `Acceleration: #, #, #`, and no fourth.
_LISTED = re.compile(r"((?:[A-Za-z_]\w* )?[A-Za-z_]\w*)\s*[:=]\s*#,?\s+#,?\s+#(?!,?\s*#)")
#: Of the lines at least this share have the pattern, which is looked for in so many.
MOSTLY, LEAST_ROWS = 0.6, 20
#: Of lines that take turns at least this share has the pattern whose numbers are named x, y and z; of so many patterns.
AT_LEAST, MOST_PATTERNS = 0.2, 4
#: Of the rows of a plain table at least this share has the same number of cells.
REGULAR = 0.99
#: Cells that change this seldom from line to line are labels.
SELDOM = 0.1


def unwrapped_lines(lines: list[str]) -> list[str] | None:
    """A header, where the pattern names its numbers, and a row a line; None where the lines are a plain table."""
    middle = [line for line in lines[len(lines) // 2 :][: dialect.HEAD] if line.strip()]
    if len(middle) < LEAST_ROWS:
        return None
    if sum(_CHECKSUM.search(line) is not None for line in middle) > MOSTLY * len(middle):
        return unwrapped_lines([_plain(line) for line in lines]) or [_plain(line) for line in lines]
    whole = record_lines.whole_records(lines, _pattern, _CLOCK)
    if whole is not None and (unwrapped := unwrapped_lines(whole)) is not None:
        return unwrapped
    pattern = _pattern_of_rows(middle) if _is_wrapped(middle) else _pattern_of_axes(middle)
    if pattern is None:
        return None
    rows = [[m[0].replace(",", ".") for m in _VALUE.finditer(_plain(x))] for x in lines if _pattern(x) == pattern]
    names = _names(pattern)
    return [*([";".join(names)] if names else []), *(";".join(row) for row in rows)]


def _pattern_of_rows(lines: list[str]) -> str | None:
    """The pattern that most lines have, if it has three numbers or more."""
    ((pattern, times),) = Counter(map(_pattern, lines)).most_common(1)
    return pattern if times >= MOSTLY * len(lines) and pattern.count(_NUMBER) >= 3 else _pattern_of_axes(lines)


def _pattern_of_axes(lines: list[str]) -> str | None:
    """Where lines of several sensors take turns, the pattern that names three axes."""
    found = Counter(map(_pattern, lines)).most_common(MOST_PATTERNS)
    often = [pattern for pattern, times in found if len(found) > 1 and AT_LEAST * len(lines) <= times]
    return next((pattern for pattern in often if axis_names.are_lettered(_names(pattern))), None)


def _is_wrapped(lines: list[str]) -> bool:
    """Whether as a plain table the lines have fewer than three columns of numbers, or a cell of several values."""
    scored = [(dialect.score(list(enumerate(lines)), d), d) for d in dialect.DELIMITERS]
    (_, columns), delimiter = max(scored, key=lambda s: (round(s[0][0], 2), s[1]))
    rows = [cells for line in lines if len(cells := dialect.split(line, delimiter)) == columns]
    if columns < 3 or len(rows) < LEAST_ROWS or (delimiter == " " and _is_ragged(lines, len(rows))):
        return True
    by_column = list(zip(*rows, strict=True))
    numeric = sum(sum(map(dialect.is_number, cells)) > 0.5 * len(cells) for cells in by_column)
    return numeric < 3 or any(_holds_several(cells) for cells in by_column)


def _is_ragged(lines: list[str], regular: int) -> bool:
    """Whether more lines have one pattern than the same number of cells, as `[ 76 190]` beside `[-100 14]`."""
    ((pattern, times),) = Counter(map(_pattern, lines)).most_common(1)
    return regular < REGULAR * len(lines) and times > regular and pattern.count(_NUMBER) >= 3


def _holds_several(cells: tuple[str, ...]) -> bool:
    if sum(map(dialect.is_number, cells)) > 0.5 * len(cells) or stamps.are_stamps(list(cells)):
        return False
    ((pattern, times),) = Counter(map(_pattern, cells)).most_common(1)
    changes = sum(a != b for a, b in pairwise(cells))
    values = pattern.count(_NUMBER) + pattern.count(_CLOCK)
    words = re.sub(r"[\s#@:/.+-]", "", pattern)
    wrapped = values > 1 or (values == 1 and words and _NUMBER in pattern)
    return bool(wrapped and words and times > 0.8 * len(cells) and changes > SELDOM * len(cells))


def _plain(line: str) -> str:
    return _CHECKSUM.sub("", line.strip())


def _pattern(line: str) -> str:
    return re.sub(
        r"(?<=[\[({])\s+|\s+(?=[\])}])",
        "",
        re.sub(r"\s+", " ", _VALUE.sub(lambda m: _CLOCK if m["clock"] else _NUMBER, _plain(line))),
    )


def _names(pattern: str) -> list[str]:
    """The names of all values of a pattern; none where not each has its own, unless three of them are axes. Of three
    behind one name they are its axes."""
    for three in (_BRACKETED, _GROUPED, _LISTED):
        pattern = three.sub(lambda m: " ".join(f"{m[1].replace(' ', '_')}_{axis}=#" for axis in "xyz"), pattern)
    parts = re.split(f"([{_NUMBER}{_CLOCK}])", pattern)
    names = []
    for before, value in zip(parts[::2], parts[1::2], strict=False):
        found = _NAME.search(before)
        names.append("time" if value == _CLOCK else found[1] if found else "")
    own = [name for name in names if name]
    whole = len(own) == len(names) or axis_names.are_lettered(own)
    return names if whole and len(set(own)) == len(own) else []
