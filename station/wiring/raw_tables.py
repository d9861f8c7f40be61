"""A file that others recorded → raw tables, whatever it is: a table, a measurement, CAN frames, a decoded log."""

from contextlib import suppress
from pathlib import Path

from station.adapters.bus import are_frames, read_log
from station.adapters.dbc import read_layouts
from station.adapters.recordings import read_tables
from station.adapters.recordings.limits import MOST_BYTES
from station.adapters.recordings.writing import write_recording
from station.domain.recognition import decoded, split_stamps, tidy
from station.domain.recognition.raw_table import RawTable
from station.errors import LogError, SamplesError, UsageError


def raw_tables(path: Path, dbc: Path | None) -> list[RawTable]:
    """Every table of a file, one for each time base or CAN message. Errors: InputError."""
    if path.suffix.lower() in (".log", ".blf", ".asc") and dbc is not None:
        return _of_frames(path, dbc)
    if path.is_file() and (path.suffix.lower() in (".blf", ".asc") or (dbc is None and are_frames(path))):
        raise UsageError("frames-need-dbc", file=str(path))
    if dbc is not None and path.suffix.lower() == ".mf4" and path.is_file() and path.stat().st_size <= MOST_BYTES:
        # Who states a DBC has frames: the reader of signals, a process of its own, is asked where there are none.
        with suppress(LogError):
            return _of_frames(path, dbc)
    tables = read_tables(path)
    if tables and dbc is not None:
        raise UsageError("dbc-without-frames", file=str(path))
    if tables:
        parts = [part for table in tables for part in decoded.of_long_form(table)]
        return [split_stamps.with_whole_stamps(tidy.of_rows_by_axis(part)) for part in parts]
    if dbc is None:
        raise UsageError("frames-need-dbc", file=str(path))
    return _of_frames(path, dbc)


def _of_frames(path: Path, dbc: Path) -> list[RawTable]:
    found = decoded.of_frames(str(path), read_log(path), read_layouts(dbc, {}).values())
    if not found:
        raise SamplesError("no-frames-of-dbc", file=str(path), dbc=str(dbc))
    return found


__all__ = ["raw_tables", "write_recording"]
