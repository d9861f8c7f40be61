"""Compressed recordings, read in a process of its own within limits: their readers are compiled code, which trusts what
a file says of its sizes and which a damaged one can crash."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from station.adapters.recordings import arrays, arrow, matlab, mf4_signals
from station.adapters.recordings.limits import check_column_names, check_unfolded
from station.domain.core.types import Array, Labels
from station.domain.recognition.raw_table import RawColumn, RawTable
from station.errors import SamplesError
from station.files.limited_process import Block, receive_blocks, send_blocks
from station.messages import Message

_TABLE, _COLUMN = b"T", b"C"
READERS = {"parquet": arrow.read_parquet, "matlab": matlab.read, "mf4": mf4_signals.read, "arrays": arrays.read}


def read(path: Path, kind: str) -> list[RawTable]:
    """The tables of a file of one of the kinds in READERS. Errors: SamplesError."""
    tables: list[tuple[dict[str, Any], list[Array]]] = []
    for block, data in receive_blocks(run_reader_process, path, kind, error=SamplesError):
        if block == _TABLE:
            tables.append((json.loads(data), []))
        else:
            head, columns = tables[-1]
            columns.append(np.frombuffer(data, head["columns"][len(columns)]["type"]))
    return [_table(path, head, columns) for head, columns in tables]


def run_reader_process(path: str, kind: str) -> None:
    """The other process: reads, and sends the tables."""
    send_blocks(_blocks(Path(path), kind))


def _blocks(path: Path, kind: str) -> Iterator[Block]:
    tables = READERS[kind](path)
    unfolded = sum(_numbers(column).nbytes for table in tables for column in table.columns)
    check_unfolded(str(path), path.stat().st_size, unfolded)
    for table in tables:
        check_column_names(str(path), (column.name for column in table.columns))
        columns = [_head(column) for column in table.columns]
        remarks = [message.document() for message in table.remarks]
        yield _TABLE, json.dumps({"rate_hz": table.rate_hz, "columns": columns, "remarks": remarks}).encode()
        for column in table.columns:
            yield _COLUMN, np.ascontiguousarray(_numbers(column)).tobytes()


def _head(column: RawColumn) -> dict[str, Any]:
    names = None if column.text is None else column.text.names
    return {"name": column.name, "unit": column.unit, "names": names, "type": _numbers(column).dtype.str}


def _numbers(column: RawColumn) -> Array:
    """Its values, or the codes of its labels."""
    values = column.values if column.text is None else column.text.code
    assert values is not None
    return values


def _table(path: Path, head: dict[str, Any], columns: list[Array]) -> RawTable:
    return RawTable(
        str(path),
        tuple(_column(of, numbers) for of, numbers in zip(head["columns"], columns, strict=True)),
        rate_hz=head["rate_hz"],
        remarks=tuple(_message(**remark) for remark in head["remarks"]),
    )


def _column(head: dict[str, Any], numbers: Array) -> RawColumn:
    if head["names"] is None:
        return RawColumn(head["name"], numbers, None, head["unit"])
    return RawColumn(head["name"], None, Labels(tuple(head["names"]), numbers), head["unit"])


def _message(id: str, **parameters: Any) -> Message:  # noqa: A002 - the word of the format
    return Message(id, **parameters)
