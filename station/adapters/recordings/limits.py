"""How much a recording may hold: a file beyond this is an accident or an attack, and is refused before it is parsed."""

from station.errors import SamplesError

MOST_BYTES = 1_000_000_000
MOST_COLUMNS = 1000
MOST_ROWS = 20_000_000
MOST_CELLS = 100_000_000
#: Characters of one line of a text.
MOST_LINE = 200_000


def check_shape(file: str, rows: int, columns: int) -> None:
    """Errors: SamplesError where a table is larger than any recording of a tumble."""
    if columns > MOST_COLUMNS:
        raise SamplesError("recording-too-wide", file=file, columns=columns, limit=MOST_COLUMNS)
    if rows > MOST_ROWS or rows * columns > MOST_CELLS:
        raise SamplesError("recording-too-long", file=file, rows=rows, columns=columns, limit=MOST_ROWS)
