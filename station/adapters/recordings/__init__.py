"""Tables of readings that others wrote: text of any dialect, MAT, Parquet, MF4 signals → raw tables. Nothing is decided
here about what the columns mean."""

from station.adapters.recordings.reading import read_tables
from station.optional_imports import load_arrow

__all__ = ["read_tables"]

load_arrow()
