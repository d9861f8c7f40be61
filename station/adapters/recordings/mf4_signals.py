"""Signals of an MF4 measurement → raw tables. Recorded CAN frames are no signals: an MF4 of them gives no table."""

from pathlib import Path
from typing import Any

import numpy as np

from station.adapters.recordings.limits import MOST_COLUMNS
from station.domain.recognition import one_clock
from station.domain.recognition.raw_table import RawColumn, RawTable
from station.errors import SamplesError
from station.messages import Message
from station.optional_imports import hide_packages


def read(path: Path) -> list[RawTable]:
    """One table for each time base, and one of axes that have a base each; none where there are only CAN frames.
    Errors: SamplesError.

    asammdf raises whatever its parsers come across in a damaged file: all of it means the same.
    """
    # Where polars is there, asammdf loads it: for tables that nobody asks for here.
    with hide_packages("polars"):
        from asammdf import MDF

    bases: dict[bytes, list[RawColumn]] = {}
    try:
        with MDF(path) as mdf:
            if "CAN_DataFrame" not in mdf.channels_db:
                for signal in mdf.iter_channels(skip_master=True):
                    _take(signal, bases)
    except MemoryError:
        raise
    except Exception as error:
        raise SamplesError("recording-not-parsed", file=str(path), reason=Message("content-damaged")) from error
    tables = [RawTable(str(path), tuple(columns)) for columns in bases.values()]
    together = one_clock.joined(tables)
    return tables if together is None else [*tables, together]


def _take(signal: Any, bases: dict[bytes, list[RawColumn]]) -> None:
    """Adds a signal to the table of its time base."""
    samples, stamps = np.asarray(signal.samples), np.asarray(signal.timestamps, float)
    full = sum(map(len, bases.values())) > MOST_COLUMNS
    if samples.ndim != 1 or samples.dtype.kind not in "iufb" or len(stamps) < 2 or full:
        return
    columns = bases.setdefault(stamps.tobytes(), [RawColumn("time", stamps, None, "s")])
    columns.append(RawColumn(str(signal.name), samples, None, str(signal.unit or "")))
