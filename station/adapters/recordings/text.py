"""CSV, TSV and any other text with a row a reading → a raw table."""

import io
import re
from pathlib import Path
from typing import Any

from station.adapters.recordings import (
    arrow,
    cells,
    dialect,
    echoed,
    json_rows,
    kinds,
    stamps,
    transposed,
    uneven,
    wrapped,
)
from station.adapters.recordings.dialect import Dialect
from station.adapters.recordings.limits import MOST_LINE, check_shape
from station.domain.recognition.raw_table import RawColumn, RawTable
from station.errors import SamplesError
from station.messages import Message

#: Rows of another length than the rest may be this share: a last line cut off, a message between.
RAGGED, FEW_RAGGED = 0.002, 5
_BEYOND_ASCII = re.compile(rb"[\x81-\xff]+")
#: Bytes of no text.
_CONTROL = re.compile(rb"[\x01-\x08\x0e-\x1a\x1c-\x1f\x7f]")


def read(path: Path) -> list[RawTable]:
    """A table of each kind of rows. Errors: SamplesError with the line at fault."""
    file = str(path)
    text, nuls = _decoded(path)
    if records := json_rows.json_tables(text):
        return [_table(file, lines, nuls) for lines in records]
    lines = text.splitlines()
    if not lines:
        raise SamplesError("recording-empty", file=file)
    longest = max(range(len(lines)), key=lambda i: len(lines[i]))
    if len(lines[longest]) > MOST_LINE:
        raise SamplesError("line-too-long", file=file, line=longest + 1, limit=MOST_LINE)
    lines = echoed.table_lines(lines) or transposed.lines_by_reading(lines) or lines
    parts = [part for part in kinds.apart(lines) if _is_table(part)] or [lines]
    if len(parts) == 1 and (unwrapped := wrapped.unwrapped_lines(dialect.without_keys(parts[0]))) is not None:
        parts = [unwrapped]
    return [_table(file, part, nuls) for part in parts]


def _is_table(lines: list[str]) -> bool:
    """Whether rows of one kind hold numbers; among several kinds one may not."""
    try:
        dialect.recognise("", lines[: dialect.HEAD])
    except SamplesError:
        return False
    return True


def _table(file: str, lines: list[str], nuls: int) -> RawTable:
    lines = dialect.without_start(dialect.without_keys(lines))
    found = dialect.recognise(file, lines[: dialect.HEAD])
    check_shape(file, len(lines) - found.first, found.columns)
    names = found.names or tuple(f"column {i}" for i in range(found.columns))
    places = [i for i in range(found.first, len(lines)) if lines[i].strip() and not dialect.is_comment(lines[i])]
    rows = [lines[i] for i in places]
    if (even := uneven.filled(rows, found)) is not None:
        rows, found = even
        names = found.names or tuple(f"column {i}" for i in range(found.columns))
    table, ragged = _parsed(file, rows, found, places)
    columns = tuple(
        _column(name, unit, table.column(i).combine_chunks(), found)
        for i, (name, unit) in enumerate(zip(names, found.units, strict=True))
    )
    remarks = [Message("rows-of-other-length", file=file, rows=ragged)] if ragged else []
    remarks += [Message("nul-bytes-left-out", file=file, count=nuls)] if nuls else []
    return RawTable(file, columns, found.names is not None, found.rate_hz, tuple(remarks))


def _decoded(path: Path) -> tuple[str, int]:
    """The text, and how many NUL bytes among it are left out: a logger that loses power leaves runs of them."""
    content = path.read_bytes()
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16", errors="replace"), 0
    nuls = content.count(b"\0")
    if nuls:
        content = content.replace(b"\0", b"")
        if not content.strip() or _CONTROL.search(content[:4096]):
            raise SamplesError("recording-not-text", file=str(path))
    try:
        return content.decode("utf-8-sig"), nuls
    except UnicodeDecodeError:
        # Of Western pages letters beyond ASCII stand alone most often; Chinese ones are pairs.
        runs = _BEYOND_ASCII.findall(content[:4096])
        pairs = all(len(run) % 2 == 0 for run in runs)
        return content.decode("gb18030" if runs and pairs else "cp1252", errors="replace"), nuls


def _parsed(file: str, lines: list[str], found: Dialect, places: list[int]) -> tuple[Any, int]:
    """An Arrow table, and how many rows of another length were left out."""
    import pyarrow as pa
    from pyarrow import csv

    delimiter = "\t" if found.delimiter == " " else found.delimiter
    if found.delimiter == " ":
        lines = ["\t".join(line.split()) for line in lines]
    else:
        lines = [_row(line, delimiter, closed=found.closed) for line in lines]
    wrong: list[tuple[int, int]] = []

    def skip(row: Any) -> str:
        wrong.append((row.number or 0, row.actual_columns))
        return "skip"

    options = csv.ReadOptions(
        column_names=[str(i) for i in range(found.columns)], block_size=(1 << 31) - 1, use_threads=False
    )
    parse = csv.ParseOptions(delimiter=delimiter, invalid_row_handler=skip)
    nulls = ["", "NaN", "nan", "NAN", "NA", "N/A", "n/a", "null", "NULL", "None", "-", "--", "#N/A", "-nan", "-NaN"]
    convert = csv.ConvertOptions(decimal_point=found.decimal, null_values=nulls, strings_can_be_null=True)
    try:
        table = csv.read_csv(io.BytesIO("\n".join(lines).encode()), options, parse, convert)
    except pa.ArrowInvalid:
        raise SamplesError("recording-not-parsed", file=file, reason=Message("content-damaged")) from None
    if len(wrong) > max(RAGGED * len(lines), min(FEW_RAGGED, 0.1 * len(lines))):
        line, cells = wrong[0]
        number = places[min(max(line - 1, 0), len(places) - 1)] + 1
        raise SamplesError("row-of-other-length", file=file, line=number, cells=cells, columns=found.columns)
    return table, len(wrong)


def _row(line: str, delimiter: str, *, closed: bool) -> str:
    plain = line.rstrip(" \r\n")
    return plain.removesuffix(delimiter) if closed else plain


def _column(name: str, unit: str, column: Any, found: Dialect) -> RawColumn:
    """Numbers, times or text."""
    values, text, more = arrow.column(column)
    if text is not None and (read := cells.numbers(text.text(), found.decimal)) is not None:
        return RawColumn(name, read[0], None, unit or read[1])
    if values is not None and stamps.are_dates(values):
        return RawColumn(name, stamps.seconds(values), None, "s")
    return RawColumn(name, values, text, more or unit)
