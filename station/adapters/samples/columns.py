"""The columns of a samples table: names, types, and which must be there (docs/formats.md, samples table)."""

from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

from station.errors import SamplesError
from station.messages import Message

if TYPE_CHECKING:
    import pyarrow as pa

SCHEMA = "station.samples/1"
TEXT_COLUMNS = ("unit", "position", "station", "nest", "lot", "operator", "seating", "simulated")
INTEGER_COLUMNS = ("run", "visit")
NUMBER_COLUMNS = (
    *("time_s", "x", "y", "z", "temperature_degC", "since_power_s", "since_clamp_s", "motor", "started_s", "counter"),
    *("gold_x", "gold_y", "gold_z"),
)
REQUIRED_COLUMNS = ("unit", "run", "visit", "position", "time_s", "x", "y", "z")
GOLD_COLUMNS = ("gold_x", "gold_y", "gold_z")
#: More columns, or a longer line of their names, has no table of one sensor, with all that somebody may have added.
MOST_COLUMNS, LONGEST_HEADER = 500, 100_000
ALL_COLUMNS = (*TEXT_COLUMNS, *INTEGER_COLUMNS, *NUMBER_COLUMNS)


def kind_of(path: Path) -> str:
    """csv or parquet, by the file's ending; SamplesError for another."""
    ending = path.suffix.lower().lstrip(".")
    if ending not in ("csv", "parquet"):
        raise SamplesError("samples-other-ending", file=str(path))
    return ending


def type_of(name: str) -> "pa.DataType":
    """Arrow type of a column."""
    import pyarrow as pa

    return pa.string() if name in TEXT_COLUMNS else pa.int64() if name in INTEGER_COLUMNS else pa.float64()


def content_of(name: str) -> Message:
    """What a column holds, as a part of a sentence."""
    if name in TEXT_COLUMNS:
        return Message("content-text")
    return Message("content-whole-numbers") if name in INTEGER_COLUMNS else Message("content-numbers")


def check_width(path: Path, columns: int, header_bytes: int = 0) -> None:
    """SamplesError for what is far wider than any samples table."""
    if columns > MOST_COLUMNS or header_bytes > LONGEST_HEADER:
        raise SamplesError("samples-too-wide", file=str(path), most=MOST_COLUMNS, bytes=LONGEST_HEADER)


def check_columns(path: Path, names: list[str]) -> None:
    """Required columns are there, none is there twice, none is misspelt; others are ignored: SamplesError."""
    for name in names:
        near = get_close_matches(name.casefold(), [k for k in ALL_COLUMNS if k not in names], 1, 0.85)
        if names.count(name) > 1:
            raise SamplesError("samples-column-twice", file=str(path), column=name)
        if name not in ALL_COLUMNS and near:
            raise SamplesError("samples-column-misspelt", file=str(path), column=name, nearest=near[0])
    missing = [name for name in REQUIRED_COLUMNS if name not in names]
    if len(missing) == len(REQUIRED_COLUMNS):
        raise SamplesError("samples-no-columns", file=str(path), required=REQUIRED_COLUMNS)
    if missing:
        raise SamplesError("samples-columns-missing", file=str(path), missing=missing, required=REQUIRED_COLUMNS)
    some = [name for name in GOLD_COLUMNS if name in names]
    if 0 < len(some) < len(GOLD_COLUMNS):
        raise SamplesError("samples-gold-incomplete", file=str(path), columns=some, required=GOLD_COLUMNS)
