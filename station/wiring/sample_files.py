"""Samples tables as files: which adapters read and write them."""

from station.adapters.samples import (
    by_units,
    join,
    portions_of_units,
    read_samples,
    rows_about,
    write_parts,
    write_samples,
)
from station.adapters.samples.checks import PieceOrigin
from station.adapters.samples.fleet import SCHEMA as FLEET_SCHEMA
from station.adapters.samples.fleet import TABLES as FLEET_TABLES
from station.adapters.samples.fleet import FleetWriter

__all__ = [
    "FLEET_SCHEMA",
    "FLEET_TABLES",
    "FleetWriter",
    "PieceOrigin",
    "by_units",
    "join",
    "portions_of_units",
    "read_samples",
    "rows_about",
    "write_parts",
    "write_samples",
]
