"""Transposed tables: a line for each axis, which begins with its name."""

from itertools import zip_longest

from station.adapters.recordings import dialect
from station.domain.recognition import axis_names

#: A transposed table has at most so many lines, of at least so many cells, and more cells than lines.
MOST_LINES, LEAST_CELLS = 40, 8


def lines_by_reading(lines: list[str]) -> list[str] | None:
    """The same table with a line a reading; None where it has that already."""
    content = [line for line in lines if line.strip() and not dialect.is_comment(line)]
    if not 3 <= len(content) <= MOST_LINES:
        return None
    for delimiter in dialect.DELIMITERS:
        rows = [dialect.split(line, delimiter) for line in content]
        width = len(rows[0])
        if width < LEAST_CELLS or width <= len(rows) or any(len(row) != width for row in rows):
            continue
        of_numbers = [row for row in rows if not dialect.is_number(row[0]) and all(map(dialect.is_number, row[1:]))]
        if axis_names.are_lettered(row[0] for row in of_numbers):
            return ["\t".join(cells) for cells in zip_longest(*rows, fillvalue="")]
    return None
