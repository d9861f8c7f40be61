"""`station segment`: a raw recording, turned by hand, becomes a samples table."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option


def command(
    recording: Annotated[Path, Argument(help="What `station import` reads, or what it and `replay --out` write.")],
    out: Annotated[Path, Option(help="Samples table to write: .csv or .parquet.")],
    columns: Annotated[str | None, Option(help="[time,]x,y,z: names, or numbers from 0.")] = None,
    time_unit: Annotated[str | None, Option(help="Unit of the stamps: s, ms, us, ns, or none.")] = None,
    rate_hz: Annotated[
        float | None, Option("--rate-hz", "--rate", help="Readings a second, where the first column only counts them.")
    ] = None,
    temperature: Annotated[str | None, Option(help="Column of the temperature.")] = None,
    blocks: Annotated[int | None, Option(help="A visit is so many readings.")] = None,
    labels: Annotated[str | None, Option(help="Column whose changes begin a visit.")] = None,
    unit: Annotated[
        str | None, Option(help="Unit of the readings: g, mg, m/s2, deg/s, rad/s, uT, LSB, …; or of x,y,z.")
    ] = None,
    zero: Annotated[float | None, Option(help="Raw reading at 0; taken off first.")] = None,
    scale: Annotated[float | None, Option(help="Then multiplied by: recipe's unit for one raw unit.")] = None,
    dbc: Annotated[Path | None, Option(help="Messages of recorded CAN frames.")] = None,
    serial: Annotated[str | None, Option(help="Serial number of the unit; left out: `unit`.")] = None,
    recipe: Annotated[str | None, Option(help="Name visits by this recipe's positions; others drop out.")] = None,
) -> int:
    """Find where a hand-held recording is at rest, and write those stretches as visits of a samples table.

    A recording in m/s² with a header, for the magnitude-only method:

        station segment turned.csv --out stops.csv
        station calibrate --samples stops.csv --recipe hand-held

    Six faces by hand, named by the recipe:

        station segment faces.csv --recipe six-point --out faces.parquet
    """
    from station.cli._import import ImportJob, import_files
    from station.domain.recognition.raw_table import ImportOptions

    places = None if columns is None else tuple(c.strip() for c in columns.split(","))
    options = ImportOptions(
        places,
        time_unit,
        rate_hz,
        temperature,
        labels,
        find_labels=False,
        blocks=blocks,
        unit=unit,
        zero=zero,
        scale=scale,
    )
    return import_files([recording], ImportJob(options, recipe, dbc, serial or "unit", segmenting=True), out)
