"""Arrow columns → raw columns; Parquet files."""

from pathlib import Path
from typing import Any

import numpy as np

from station.adapters.recordings.limits import check_names, check_shape, check_unfolded
from station.domain.core.types import Array, Labels
from station.domain.recognition.raw_table import RawColumn, RawTable
from station.errors import SamplesError
from station.messages import Message


def read_parquet(path: Path) -> list[RawTable]:
    """One table: the columns of a Parquet file that are numbers, times or text. Errors: SamplesError."""
    import pyarrow as pa
    from pyarrow import parquet

    try:
        with parquet.ParquetFile(str(path)) as file:
            shape = file.metadata.num_rows, file.metadata.num_columns
            check_shape(str(path), *shape)
            check_names(str(path), file.schema_arrow.names)
            groups = (file.metadata.row_group(i) for i in range(file.metadata.num_row_groups))
            unfolded = max(sum(group.total_byte_size for group in groups), 8 * shape[0] * shape[1])
            check_unfolded(str(path), path.stat().st_size, unfolded)
            table = file.read(use_threads=False)
    except (pa.ArrowException, UnicodeDecodeError) as exc:
        raise SamplesError("recording-not-parsed", file=str(path), reason=Message("content-damaged")) from exc
    if table.num_rows == 0 or table.num_columns == 0:
        raise SamplesError("recording-empty", file=str(path))
    columns = []
    for name, kind in zip(table.schema.names, table.schema.types, strict=True):
        if pa.types.is_nested(kind):
            continue
        values, text, unit = column(table.column(name).combine_chunks())
        columns.append(RawColumn(name, values, text, unit))
    if not columns:
        raise SamplesError("no-table-of-numbers", file=str(path))
    return [RawTable(str(path), tuple(columns))]


def column(cells: Any) -> tuple[Array | None, Labels | None, str]:
    """Numbers or labels of an Arrow array, and the unit that its type states (of times)."""
    import pyarrow as pa

    kind = cells.type
    if pa.types.is_dictionary(kind):
        cells, kind = cells.dictionary_decode(), kind.value_type
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind) or pa.types.is_time(kind):
        wide = pa.int32() if pa.types.is_time32(kind) else pa.int64()
        return _filled(cells.cast(wide)), None, str(kind.unit)
    if pa.types.is_date(kind):
        return _filled(cells.cast(pa.date32()).cast(pa.int32())) * 86_400, None, "s"
    if pa.types.is_null(kind):
        return np.full(len(cells), np.nan), None, ""
    if pa.types.is_integer(kind) or pa.types.is_floating(kind):
        return _filled(cells), None, ""
    if pa.types.is_boolean(kind) or pa.types.is_decimal(kind):
        return _filled(cells.cast(pa.int8() if pa.types.is_boolean(kind) else pa.float64())), None, ""
    encoded = cells.cast(pa.string()).fill_null("").dictionary_encode()
    names = tuple(str(n) for n in encoded.dictionary.to_pylist())
    return None, Labels(names, np.asarray(encoded.indices.to_numpy(zero_copy_only=False), np.int32)), ""


def _filled(cells: Any) -> Array:
    """Numbers (n); missing ones make floats with NaN of them."""
    return np.asarray(cells.to_numpy(zero_copy_only=False))
