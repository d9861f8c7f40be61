"""A samples table into a file, piece by piece."""

from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from station.adapters.samples.columns import ALL_COLUMNS, GOLD_COLUMNS, REQUIRED_COLUMNS, SCHEMA, kind_of, type_of
from station.domain.core.joined_tables import join
from station.domain.core.types import Labels, SampleTable

if TYPE_CHECKING:
    import pyarrow as pa

#: Rows of one piece at most, and rows that small parts are gathered to.
PIECE, GATHERED = 1 << 18, 1 << 14


def write_samples(table: SampleTable, path: Path) -> None:
    """Writes .csv or .parquet (schema name in its metadata). Errors: SamplesError for another ending, OSError."""
    write_parts([table], path)


def write_parts(tables: Iterable[SampleTable], path: Path, more: Mapping[str, str] | None = None) -> None:
    """The same for a table that comes in parts with the same columns; memory follows the part and not the file.

    more: written into a Parquet file's metadata next to the schema; a CSV has no place for it.
    """
    kind = kind_of(path)
    gathered = _gathered(tables)
    batches = (_batch(table[a : a + PIECE]) for table in gathered for a in range(0, max(len(table), 1), PIECE))
    first = next(batches)
    schema = first.schema.with_metadata({**(more or {}), "schema": SCHEMA})
    (_write_csv if kind == "csv" else _write_parquet)(path, schema, chain([first], batches))


def _gathered(tables: Iterable[SampleTable]) -> Iterator[SampleTable]:
    """The same rows in fewer parts: a Parquet file keeps some 30 kB of memory for each piece until it is closed."""
    held: list[SampleTable] = []
    for table in tables:
        held.append(table)
        if sum(map(len, held)) >= GATHERED:
            yield join(held)
            held = []
    if held:
        yield join(held)


def _write_csv(path: Path, schema: "pa.Schema", batches: Iterable["pa.RecordBatch"]) -> None:
    from pyarrow import csv

    with csv.CSVWriter(str(path), schema, write_options=csv.WriteOptions(quoting_style="needed")) as writer:
        for batch in batches:
            writer.write_batch(batch)


def _write_parquet(path: Path, schema: "pa.Schema", batches: Iterable["pa.RecordBatch"]) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    with parquet.ParquetWriter(str(path), schema, compression="zstd") as writer:
        for batch in batches:
            writer.write_table(pa.Table.from_batches([batch]).replace_schema_metadata(schema.metadata))


def _batch(table: SampleTable) -> "pa.RecordBatch":
    import pyarrow as pa

    gold = {} if table.gold is None else dict(zip(GOLD_COLUMNS, table.gold.T, strict=True))
    columns: dict[str, Any] = {
        "unit": _text(table.unit),
        "run": table.run,
        "visit": table.visit,
        "position": _text(table.position),
        "time_s": table.time_s,
        **dict(zip("xyz", table.reading.T, strict=True)),
        **{k: _text(v) for k, v in table.labels.items()},
        **{k: np.asarray(v, float) for k, v in table.values.items()},
        **gold,
    }
    order = [n for n in (*REQUIRED_COLUMNS, *ALL_COLUMNS) if n in columns]
    arrays = [pa.array(columns[n], type_of(n)) for n in dict.fromkeys(order)]
    return pa.RecordBatch.from_arrays(arrays, names=list(dict.fromkeys(order)))


def _text(labels: Labels) -> "pa.Array":
    """A text column; no Python string is made for a row."""
    import pyarrow as pa

    names = pa.array(labels.names, pa.string())
    return pa.DictionaryArray.from_arrays(pa.array(labels.code, pa.int32()), names).dictionary_decode()
