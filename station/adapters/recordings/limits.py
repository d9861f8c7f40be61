"""How much a recording may hold: a file beyond this is an accident or an attack, and is refused before it is parsed."""

from collections.abc import Iterable

from station.errors import SamplesError

MOST_BYTES = 1_000_000_000
MOST_COLUMNS = 1000
MOST_ROWS = 20_000_000
MOST_CELLS = 100_000_000
#: Characters of one line of a text, and of a column's name.
MOST_LINE, MOST_NAME = 200_000, 200
#: Noise does not compress: what unfolds to more than so many times the file, and to more than so many bytes, is none.
MOST_UNFOLDING, LEAST_UNFOLDED = 20, 128_000_000


def check_column_names(file: str, names: Iterable[str]) -> None:
    """Errors: SamplesError where the name of a column is longer than any that a person or logger gives."""
    for number, name in enumerate(names, 1):
        if len(name) > MOST_NAME:
            raise SamplesError("recording-name-too-long", file=file, column=number, limit=MOST_NAME)


def check_unfolded(file: str, size: int, unfolded: int) -> None:
    """Errors: SamplesError where a file of that size (bytes) unfolds to more than any measurement compresses to."""
    if unfolded > max(LEAST_UNFOLDED, MOST_UNFOLDING * size):
        raise SamplesError("recording-unfolds", file=file, size_mb=size / 1e6, unfolded_mb=unfolded / 1e6)


def check_shape(file: str, rows: int, columns: int) -> None:
    """Errors: SamplesError where a table is larger than any recording of a tumble."""
    if columns > MOST_COLUMNS:
        raise SamplesError("recording-too-wide", file=file, columns=columns, limit=MOST_COLUMNS)
    if rows > MOST_ROWS or rows * columns > MOST_CELLS:
        raise SamplesError("recording-too-long", file=file, rows=rows, columns=columns, limit=MOST_ROWS)
