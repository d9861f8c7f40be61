"""`station segment`: a raw recording, turned by hand, becomes a samples table."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option


def command(
    recording: Annotated[Path, Argument(help="Text: a header or none, columns by comma or blanks.")],
    out: Annotated[Path, Option(help="Samples table to write: .csv or .parquet.")],
    columns: Annotated[str, Option(help="Time, x, y, z: names, or numbers from 0.")] = "0,1,2,3",
    rate_hz: Annotated[float | None, Option(help="Readings a second, where the first column only counts them.")] = None,
    zero: Annotated[float, Option(help="Raw reading at 0; taken off first.")] = 0.0,
    scale: Annotated[float, Option(help="Then multiplied by: recipe's unit for one raw unit.")] = 1.0,
    serial: Annotated[str, Option(help="Serial number of the unit.")] = "unit",
    recipe: Annotated[str | None, Option(help="Name stops by this recipe's nearest position; others drop out.")] = None,
) -> int:
    """Find where a hand-held recording lies still, and write those stretches as visits of a samples table.

    A recording in m/s² with a header, for the magnitude-only method:

        station segment turned.csv --columns t,ax,ay,az --scale 0.101972 --out samples.csv
        station calibrate --samples samples.csv --recipe hand-held

    Six faces by hand, named by the recipe:

        station segment faces.csv --recipe six-point --out samples.csv
    """
    from station.cli._segment import Recording, segment

    return segment(Recording(recording, tuple(columns.split(",")), rate_hz, zero, scale), serial, recipe, out)
