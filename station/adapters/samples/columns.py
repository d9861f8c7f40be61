"""The columns of a samples table: names, types, and which must be there (contracts, section 3)."""

from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

from station.errors import SamplesError

if TYPE_CHECKING:
    import pyarrow as pa

SCHEMA = "station.samples/1"
TEXT_COLUMNS = ("unit", "position", "station", "nest", "lot", "operator", "seating")
INTEGER_COLUMNS = ("run", "visit")
NUMBER_COLUMNS = (
    *("time_s", "x", "y", "z", "temperature_degC", "since_power_s", "since_clamp_s", "motor", "started_s", "counter"),
    *("gold_x", "gold_y", "gold_z"),
)
REQUIRED_COLUMNS = ("unit", "run", "visit", "position", "time_s", "x", "y", "z")
GOLD_COLUMNS = ("gold_x", "gold_y", "gold_z")
KNOWN_COLUMNS = (*TEXT_COLUMNS, *INTEGER_COLUMNS, *NUMBER_COLUMNS)


def kind_of(path: Path) -> str:
    """csv or parquet, by the file's ending; SamplesError for another."""
    ending = path.suffix.lower().lstrip(".")
    if ending not in ("csv", "parquet"):
        raise SamplesError(f"{path}: a samples table is a .csv or a .parquet file; rename or convert it")
    return ending


def type_of(name: str) -> "pa.DataType":
    """Arrow type of a column."""
    import pyarrow as pa

    return pa.string() if name in TEXT_COLUMNS else pa.int64() if name in INTEGER_COLUMNS else pa.float64()


def in_words(name: str) -> str:
    """What stands in a column, for a sentence."""
    return "text" if name in TEXT_COLUMNS else "whole numbers" if name in INTEGER_COLUMNS else "numbers"


def check_columns(path: Path, names: list[str]) -> None:
    """Required columns are there, none is double, none is a known one misspelt; others are left alone: SamplesError."""
    for name in names:
        near = get_close_matches(name.casefold(), [k for k in KNOWN_COLUMNS if k not in names], 1, 0.85)
        if names.count(name) > 1:
            raise SamplesError(f"{path} has column {name!r} twice; keep one of them")
        if name not in KNOWN_COLUMNS and near:
            raise SamplesError(f"{path} has a column {name!r}, which means nothing here; did you mean {near[0]!r}?")
    missing = [name for name in REQUIRED_COLUMNS if name not in names]
    if missing:
        told = ", ".join(missing)
        raise SamplesError(f"{path} has no column {told}; a samples table needs {', '.join(REQUIRED_COLUMNS)}")
    some = [name for name in GOLD_COLUMNS if name in names]
    if 0 < len(some) < len(GOLD_COLUMNS):
        raise SamplesError(
            f"{path} has {', '.join(some)} but not all of {', '.join(GOLD_COLUMNS)}; add the missing ones"
        )
