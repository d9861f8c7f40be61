"""Signals of an MF4 measurement, read in a process of its own: asammdf is compiled code, and a damaged file can crash
it. Recorded CAN frames are no signals: an MF4 of them gives no table."""

import io
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from station.adapters.recordings.limits import MOST_COLUMNS
from station.domain.core.types import Array
from station.domain.recognition.raw_table import RawColumn, RawTable
from station.errors import SamplesError

#: Reading takes seconds; a file that keeps its reader longer is broken.
MOST_S = 120.0
_CODE = (
    "import sys; sys.path[:] = {path!r}; "
    "from station.adapters.recordings.mf4_signals import run_reader_process as run; run(sys.argv[1])"
)


def read(path: Path) -> list[RawTable]:
    """One table for each time base; none where there are only CAN frames. Errors: SamplesError."""
    command = [sys.executable, "-c", _CODE.format(path=sys.path), str(path)]
    quiet = subprocess.DEVNULL
    try:
        done = subprocess.run(command, stdin=quiet, stdout=subprocess.PIPE, stderr=quiet, timeout=MOST_S, check=True)
        with np.load(io.BytesIO(done.stdout), allow_pickle=False) as arrays:
            tables = json.loads(str(arrays["tables"]))
            return [_table(path, group, arrays) for group in tables]
    except (subprocess.SubprocessError, ValueError, OSError, KeyError, EOFError):
        raise SamplesError("recording-not-parsed", file=str(path), reason="its reader breaks off") from None


def _table(path: Path, group: list[dict[str, str]], arrays: Any) -> RawTable:
    columns = [RawColumn(c["name"], arrays[c["key"]], None, c["unit"]) for c in group]
    return RawTable(str(path), tuple(columns))


def run_reader_process(path: str) -> None:
    """The other process: every time base with its signals, as NumPy arrays on standard output."""
    from asammdf import MDF

    arrays: dict[str, Array] = {}
    tables: list[list[dict[str, str]]] = []
    bases: dict[bytes, int] = {}
    with MDF(path) as mdf:
        if "CAN_DataFrame" not in mdf.channels_db:
            for signal in mdf.iter_channels(skip_master=True):
                _take(signal, arrays, tables, bases)
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, tables=np.array(json.dumps(tables)), **arrays)
    sys.stdout.buffer.write(buffer.getvalue())


def _take(signal: Any, arrays: dict[str, Array], tables: list[list[dict[str, str]]], bases: dict[bytes, int]) -> None:
    """Adds a signal to the table of its time base."""
    samples, stamps = np.asarray(signal.samples), np.asarray(signal.timestamps, float)
    if samples.ndim != 1 or samples.dtype.kind not in "iufb" or len(stamps) < 2 or len(arrays) > MOST_COLUMNS:
        return
    base = stamps.tobytes()
    if base not in bases:
        bases[base] = len(tables)
        arrays[f"a{len(arrays)}"] = stamps
        tables.append([{"name": "time", "unit": "s", "key": f"a{len(arrays) - 1}"}])
    key = f"a{len(arrays)}"
    arrays[key] = samples
    tables[bases[base]].append({"name": str(signal.name), "unit": str(signal.unit or ""), "key": key})
