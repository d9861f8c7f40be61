"""A samples table into a file, piece by piece."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from station.adapters.samples.columns import GOLD, KNOWN, REQUIRED, SCHEMA, kind_of, type_of
from station.domain.types import SampleTable

if TYPE_CHECKING:
    import pyarrow as pa

#: Rows of one piece.
PIECE = 1 << 18


def write_samples(table: SampleTable, path: Path) -> None:
    """Writes .csv or .parquet (schema name in its metadata). Errors: SamplesError for another ending, OSError."""
    import pyarrow as pa

    kind = kind_of(path)
    parts = [_batch(table[a : a + PIECE]) for a in range(0, max(len(table), 1), PIECE)]
    schema = parts[0].schema
    if kind == "csv":
        from pyarrow import csv

        with csv.CSVWriter(str(path), schema, write_options=csv.WriteOptions(quoting_style="needed")) as writer:
            for part in parts:
                writer.write_batch(part)
        return
    from pyarrow import parquet

    marked = schema.with_metadata({"schema": SCHEMA})
    with parquet.ParquetWriter(str(path), marked, compression="zstd") as writer:
        for part in parts:
            writer.write_table(pa.Table.from_batches([part]).replace_schema_metadata({"schema": SCHEMA}))


def _batch(table: SampleTable) -> "pa.RecordBatch":
    import pyarrow as pa

    gold = {} if table.gold is None else dict(zip(GOLD, table.gold.T, strict=True))
    columns: dict[str, Any] = {
        "unit": table.unit.text(),
        "run": table.run,
        "visit": table.visit,
        "position": table.position.text(),
        "time_s": table.time_s,
        **dict(zip("xyz", table.reading.T, strict=True)),
        **{k: v.text() for k, v in table.labels.items()},
        **{k: np.asarray(v, float) for k, v in table.values.items()},
        **gold,
    }
    order = [n for n in (*REQUIRED, *KNOWN) if n in columns]
    arrays = [pa.array(columns[n], type_of(n)) for n in dict.fromkeys(order)]
    return pa.RecordBatch.from_arrays(arrays, names=list(dict.fromkeys(order)))
