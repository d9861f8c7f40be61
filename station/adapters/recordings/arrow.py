"""Arrow columns → raw columns; Parquet files."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from station.adapters.recordings import cells
from station.adapters.recordings.limits import check_column_names, check_shape, check_unfolded
from station.domain.core.types import Array, Labels
from station.domain.recognition.raw_table import RawColumn, RawTable
from station.errors import SamplesError
from station.messages import Message

#: Structs in structs, and places of a list, that are columns.
DEEPEST, WIDEST = 3, 16


def read_parquet(path: Path) -> list[RawTable]:
    """One table: the columns of a Parquet file that are numbers, times or text. Errors: SamplesError."""
    import pyarrow as pa
    from pyarrow import parquet

    try:
        with parquet.ParquetFile(str(path)) as file:
            shape = file.metadata.num_rows, file.metadata.num_columns
            check_shape(str(path), *shape)
            check_column_names(str(path), file.schema_arrow.names)
            groups = (file.metadata.row_group(i) for i in range(file.metadata.num_row_groups))
            unfolded = max(sum(group.total_byte_size for group in groups), 8 * shape[0] * shape[1])
            check_unfolded(str(path), path.stat().st_size, unfolded)
            table = file.read(use_threads=False)
            table.validate(full=True)  # text that is none: Arrow reads it unseen
    except (pa.ArrowException, UnicodeDecodeError) as exc:
        raise SamplesError("recording-not-parsed", file=str(path), reason=Message("content-damaged")) from exc
    if table.num_rows == 0 or table.num_columns == 0:
        raise SamplesError("recording-empty", file=str(path))
    columns = []
    for name, part in _parts(table):
        values, text, unit = column(part)
        read = None if text is None else cells.numbers(text.text(), ".")
        columns.append(RawColumn(name, values, text, unit) if read is None else RawColumn(name, read[0], None, read[1]))
    if not columns:
        raise SamplesError("no-table-of-numbers", file=str(path))
    return [RawTable(str(path), tuple(columns))]


def _parts(table: Any) -> Iterator[tuple[str, Any]]:
    """Plain columns (name, cells): of structs their fields, of short lists of one length their places."""
    import pyarrow as pa

    for _ in range(DEEPEST):
        table = table.flatten()
    for name, kind in zip(table.schema.names, table.schema.types, strict=True):
        whole = table.column(name).combine_chunks()
        if not pa.types.is_nested(kind):
            yield name, whole
        elif pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind):
            yield from _places(name, whole)


def _places(name: str, lists: Any) -> Iterator[tuple[str, Any]]:
    import pyarrow as pa
    from pyarrow import compute

    lengths = compute.unique(compute.list_value_length(lists)).to_pylist()
    if len(lengths) == 1 and lengths[0] and lengths[0] <= WIDEST and not pa.types.is_nested(lists.type.value_type):
        yield from ((f"{name}_{i}", compute.list_element(lists, i)) for i in range(lengths[0]))


def column(part: Any) -> tuple[Array | None, Labels | None, str]:
    """Numbers or labels of an Arrow array, and the unit that its type states (of times)."""
    import pyarrow as pa

    kind = part.type
    if pa.types.is_dictionary(kind):
        part, kind = part.dictionary_decode(), kind.value_type
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind) or pa.types.is_time(kind):
        wide = pa.int32() if pa.types.is_time32(kind) else pa.int64()
        return _filled(part.cast(wide)), None, str(kind.unit)
    if pa.types.is_date(kind):
        return _filled(part.cast(pa.date32()).cast(pa.int32())) * 86_400, None, "s"
    if pa.types.is_null(kind):
        return np.full(len(part), np.nan), None, ""
    if pa.types.is_integer(kind) or pa.types.is_floating(kind):
        return _filled(part), None, ""
    if pa.types.is_boolean(kind) or pa.types.is_decimal(kind):
        return _filled(part.cast(pa.int8() if pa.types.is_boolean(kind) else pa.float64())), None, ""
    encoded = part.cast(pa.string()).fill_null("").dictionary_encode()
    names = tuple(str(n) for n in encoded.dictionary.to_pylist())
    return None, Labels(names, np.asarray(encoded.indices.to_numpy(zero_copy_only=False), np.int32)), ""


def _filled(cells: Any) -> Array:
    """Numbers (n); missing ones make floats with NaN of them."""
    return np.asarray(cells.to_numpy(zero_copy_only=False))
