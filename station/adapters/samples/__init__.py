"""Samples tables (`station.samples/1`) as CSV and Parquet: read in pieces, checked cell by cell, written in pieces."""

from station.adapters.samples.reading import (
    by_units,
    pieces,
    portions_of_units,
    read_samples,
    rows_about,
)
from station.adapters.samples.writing import write_parts, write_samples
from station.domain.core.joined_tables import join
from station.optional_imports import load_arrow

__all__ = [
    "by_units",
    "join",
    "pieces",
    "portions_of_units",
    "read_samples",
    "rows_about",
    "write_parts",
    "write_samples",
]

load_arrow()
