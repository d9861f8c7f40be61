"""Recordings as raw tables for `station segment`: unit, run, time_s, x, y, z, temperature_degC; one row a reading."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from station.domain.recognition.samples import UnitRecording
from station.errors import SamplesError
from station.messages import system_reason


def write_recording(passes: Sequence[UnitRecording], path: Path) -> None:
    """Writes .csv or .parquet, by the ending. Errors: SamplesError."""
    import pyarrow as pa
    from pyarrow import csv, parquet

    ending = path.suffix.lower()
    if ending not in (".csv", ".parquet"):
        raise SamplesError("recording-ending-unknown", file=str(path))
    warm = all(p.recording.temperature_degC is not None for p in passes)
    lengths = [len(p.recording) for p in passes]
    reading = np.concatenate([p.recording.reading for p in passes])
    columns = {
        "unit": pa.array(np.repeat([p.serial for p in passes], lengths)),
        "run": pa.array(np.repeat([p.run for p in passes], lengths)),
        "time_s": pa.array(np.concatenate([p.recording.time_s for p in passes])),
        **{axis: pa.array(reading[:, i].copy()) for i, axis in enumerate("xyz")},
    }
    if warm:
        columns["temperature_degC"] = pa.array(np.concatenate([p.recording.temperature_degC for p in passes]))
    table = pa.table(columns)
    try:
        if ending == ".csv":
            csv.write_csv(table, str(path))
        else:
            parquet.write_table(table, str(path), compression="zstd")
    except OSError as error:
        raise SamplesError("file-not-writable", file=str(path), reason=system_reason(error)) from None
