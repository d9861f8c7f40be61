"""A samples table out of a file, piece by piece, each checked."""

import errno
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from station.adapters.samples.checks import PieceOrigin, check_cells, explain_csv
from station.adapters.samples.columns import (
    ALL_COLUMNS,
    GOLD_COLUMNS,
    LONGEST_HEADER,
    NUMBER_COLUMNS,
    SCHEMA,
    TEXT_COLUMNS,
    check_columns,
    check_width,
    content_of,
    kind_of,
    type_of,
)
from station.adapters.samples.gathering import gather
from station.domain.core.joined_tables import join
from station.domain.core.types import Labels, SampleTable
from station.errors import SamplesError
from station.files.limited_process import memory_ceiling
from station.messages import system_reason

if TYPE_CHECKING:
    import pyarrow as pa
    from pyarrow import parquet

#: Rows of one piece of Parquet, bytes of one block of CSV text, and rows of one portion of whole units.
PIECE = 1 << 16
BLOCK = 1 << 22
PORTION = 100_000
#: Noise does not compress: measured tables come to a fifth, runs and names in them to nothing. A file that unfolds to
#: more than so many times its size, and to more than so many bytes, was made to fill memory.
MOST_UNFOLDING, LEAST_UNFOLDED = 50, 64_000_000
#: Bytes that one piece may take while it is read.
MOST_MEMORY = 400 << 20
#: Room for rows beside those that a file seems to have, and the most that is made at once.
ROOM, MOST_ROOM = 1.05, 20_000_000


def read_samples(path: Path) -> SampleTable:
    """The whole table. Errors: SamplesError with file, row, column and remedy."""
    import pyarrow as pa

    table = gather(pieces(path), min(int(ROOM * rows_about(path)), MOST_ROOM))
    # Arrow keeps what it has freed: as much again as a fleet's table.
    pa.default_memory_pool().release_unused()
    return table


def rows_about(path: Path) -> int:
    """How many rows a table holds: of Parquet as it says, of CSV by its size and its first lines; 0 where nothing can
    be read."""
    try:
        if kind_of(path) == "csv":
            with path.open("rb") as file:
                lines = [len(line) for line in islice(file, 1, 1001)]
            return int(path.stat().st_size * len(lines) / max(sum(lines), 1))
        from pyarrow import ArrowException, parquet

        try:
            return int(parquet.ParquetFile(str(path)).metadata.num_rows)
        except (ArrowException, UnicodeDecodeError):
            return 0
    except OSError:
        return 0


def by_units(path: Path, rows: int = PORTION) -> Iterator[SampleTable]:
    """The table in portions of whole units, about `rows` rows each, where the file keeps each unit's rows together;
    else in one. Memory then follows the portion and not the file. Errors: SamplesError."""
    if units_contiguous(path):
        yield from portions_of_units(path, rows)
    else:
        yield read_samples(path)


def portions_of_units(path: Path, rows: int = PORTION) -> Iterator[SampleTable]:
    """The same of a file that is known to keep each unit's rows together. Errors: SamplesError."""
    import pyarrow as pa

    held: list[SampleTable] = []
    for piece in pieces(path):
        other = np.flatnonzero(piece.unit.code != piece.unit.code[-1])
        begins = int(other[-1]) + 1 if len(other) else 0
        if begins and sum(map(len, held)) + begins >= rows:
            # Only the portion and what comes after it are held while it is looked at.
            portion, held = join([*held, piece[:begins]]), [piece[begins:]]
            del piece
            yield portion
            del portion
            # Arrow keeps what it has freed, and would come to hold several portions.
            pa.default_memory_pool().release_unused()
        else:
            held.append(piece)
    yield join(held)
    held.clear()
    pa.default_memory_pool().release_unused()


def pieces(path: Path) -> Iterator[SampleTable]:
    """The table piece by piece, each checked. Errors: SamplesError."""
    row, some = 0, False
    for batch in _batches(path):
        if batch.num_rows:
            some = True
            yield check_cells(_table(batch), PieceOrigin(path, row))
            row += batch.num_rows
    if not some:
        raise SamplesError("samples-empty", file=str(path))


def _batches(path: Path, columns: tuple[str, ...] | None = None) -> "Iterator[pa.RecordBatch]":
    """Record batches with the columns of the format (or the named ones) in their own types."""
    if not path.is_file():
        error = IsADirectoryError(errno.EISDIR, "") if path.is_dir() else FileNotFoundError(errno.ENOENT, "")
        raise SamplesError("samples-no-file", file=str(path), why=system_reason(error))
    yield from (_csv(path, columns) if kind_of(path) == "csv" else _parquet(path, columns))


def _csv(path: Path, columns: tuple[str, ...] | None) -> "Iterator[pa.RecordBatch]":
    import pyarrow as pa
    from pyarrow import csv

    names = _header(path)
    check_columns(path, names)
    wanted = [n for n in (columns or ALL_COLUMNS) if n in names]
    # Text that is read as codes needs none of Arrow's compute functions.
    coded = pa.dictionary(pa.int32(), pa.string())
    try:
        with csv.open_csv(
            str(path),
            read_options=csv.ReadOptions(block_size=BLOCK),
            convert_options=csv.ConvertOptions(
                column_types={n: coded if n in TEXT_COLUMNS else type_of(n) for n in wanted},
                include_columns=wanted,
                strings_can_be_null=False,
            ),
        ) as reader:
            yield from reader
    except (pa.ArrowInvalid, pa.ArrowKeyError) as exc:
        raise SamplesError(explain_csv(path, wanted, exc)) from exc


def _header(path: Path) -> list[str]:
    import csv

    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            first = file.readline(LONGEST_HEADER + 1)
        check_width(path, first.count(",") + 1, len(first))
        row = next(csv.reader([first]), [])
    except (UnicodeDecodeError, csv.Error) as exc:
        raise SamplesError("samples-not-utf8", file=str(path)) from exc
    return [name.strip() for name in row]


def _parquet(path: Path, columns: tuple[str, ...] | None) -> "Iterator[pa.RecordBatch]":
    import pyarrow as pa
    from pyarrow import parquet

    try:
        text = [n for n in parquet.read_schema(str(path)).names if n in TEXT_COLUMNS]
        # Read ahead, the whole file would stay in memory until it is closed.
        with parquet.ParquetFile(str(path), pre_buffer=False, read_dictionary=text) as file:
            names = file.schema_arrow.names
            check_width(path, len(names))
            _check_unfolded(path, file.metadata)
            schema = (file.schema_arrow.metadata or {}).get(b"schema", SCHEMA.encode()).decode(errors="replace")
            if schema != SCHEMA:
                raise SamplesError("samples-other-schema", file=str(path), schema=schema, expected=SCHEMA)
            check_columns(path, names)
            batches = file.iter_batches(
                PIECE, columns=[n for n in (columns or ALL_COLUMNS) if n in names], use_threads=False
            )
            while (batch := _next(path, batches)) is not None:
                batch.validate(full=True)  # text that is none, codes beyond their names: Arrow reads them unseen
                yield _cast(path, batch)
    except (pa.ArrowException, UnicodeDecodeError, OSError) as exc:
        raise SamplesError("samples-no-parquet", file=str(path)) from exc


def _next(path: Path, batches: "Iterator[pa.RecordBatch]") -> "pa.RecordBatch | None":
    """The next piece, within a limit of memory: what a file says of the size of its pages may be a lie."""
    with memory_ceiling(path, MOST_MEMORY, SamplesError):
        return next(batches, None)


def _check_unfolded(path: Path, content: "parquet.FileMetaData") -> None:
    """SamplesError for a file whose cells take far more memory than any measurement compresses to."""
    pages = sum(content.row_group(i).total_byte_size for i in range(content.num_row_groups))
    size, unfolded = path.stat().st_size, max(8 * content.num_rows * content.num_columns, pages)
    if unfolded > max(LEAST_UNFOLDED, MOST_UNFOLDING * size):
        raise SamplesError("samples-unfolds", file=str(path), size_mb=size / 1e6, unfolded_mb=unfolded / 1e6)


def _cast(path: Path, batch: "pa.RecordBatch") -> "pa.RecordBatch":
    import pyarrow as pa

    columns = []
    for name in batch.schema.names:
        column, wanted = batch.column(name), type_of(name)
        # Where nothing needs a cast, Arrow's compute functions need not be loaded.
        if column.type == wanted or column.type == pa.dictionary(pa.int32(), wanted):
            columns.append(column)
            continue
        try:
            columns.append(column.cast(wanted))
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError) as exc:
            kind, content = str(batch.schema.field(name).type), content_of(name)
            raise SamplesError("samples-other-type", file=str(path), column=name, type=kind, content=content) from exc
    return pa.RecordBatch.from_arrays(columns, names=batch.schema.names)


def units_contiguous(path: Path) -> bool:
    """Whether the rows of each unit follow each other."""
    finished: set[str] = set()
    last = None
    for batch in _batches(path, ("unit",)):
        units = batch.column("unit").dictionary_encode()
        code = _numbers(units.indices)
        turns = code[np.r_[True, code[1:] != code[:-1]]] if len(code) else []
        for i in turns:
            name = units.dictionary[int(i)].as_py()
            if name != last and name in finished:
                return False
            finished.add(name)
            last = name
    return True


def _table(batch: "pa.RecordBatch") -> SampleTable:
    def numbers(name: str) -> Any:
        return _numbers(batch.column(name))

    names = batch.schema.names
    gold = np.stack([numbers(n) for n in GOLD_COLUMNS]).T if GOLD_COLUMNS[0] in names else None
    return SampleTable(
        unit=_labels(batch, "unit"),
        run=numbers("run"),
        visit=numbers("visit"),
        position=_labels(batch, "position"),
        time_s=numbers("time_s"),
        reading=np.stack([numbers(n) for n in "xyz"]).T,
        labels={n: _labels(batch, n) for n in TEXT_COLUMNS[2:] if n in names},
        values={n: numbers(n) for n in NUMBER_COLUMNS[4:10] if n in names},
        gold=gold,
    )


def _numbers(column: "pa.Array") -> Any:
    """A column of numbers, which outlive what Arrow holds."""
    return np.array(column.to_numpy(zero_copy_only=False))


def _labels(batch: "pa.RecordBatch", name: str) -> Labels:
    import pyarrow as pa

    column = batch.column(name)
    if column.null_count:
        column = column.cast(pa.string()).fill_null("")
    # Text comes encoded, but for what was cast.
    column = column.dictionary_encode()
    names, code = column.dictionary.to_pylist(), _numbers(column.indices).astype(np.int32)
    used = np.flatnonzero(np.bincount(code, minlength=len(names)))
    return Labels(tuple(names[i] for i in used), np.searchsorted(used, code).astype(np.int32))
