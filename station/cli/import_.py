"""`station import`: any table of readings becomes a samples table."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

#: Options that none of these words may stand beside.
APART = {"--units": ("--runs",)}


def command(
    files: Annotated[list[Path], Argument(help="CSV, TSV, other text, .mat, .parquet, .mf4; CAN logs with --dbc.")],
    out: Annotated[Path | None, Option(help="Write there: .csv or .parquet. Left out: only print.")] = None,
    raw: Annotated[bool, Option("--raw", help="Write the whole recording for `segment`, not its visits.")] = False,
    recipe: Annotated[str | None, Option(help="Scale to this recipe's unit and name visits by its positions.")] = None,
    columns: Annotated[str | None, Option(help="[time,]x,y,z: names, or numbers from 0.")] = None,
    time_unit: Annotated[str | None, Option(help="Unit of the stamps: s, ms, us, ns, min, h, d, or none.")] = None,
    rate: Annotated[float | None, Option(help="Readings a second, where no column is time.")] = None,
    temperature: Annotated[str | None, Option(help="Column of the temperature.")] = None,
    labels: Annotated[str | None, Option(help="Column whose changes begin a visit.")] = None,
    blocks: Annotated[int | None, Option(help="A visit is so many readings.")] = None,
    unit: Annotated[
        str | None, Option(help="Unit of the readings: g, mg, m/s2, deg/s, rad/s, uT, LSB, …; or of x,y,z.")
    ] = None,
    zero: Annotated[float | None, Option(help="Raw reading at 0; taken off first.")] = None,
    scale: Annotated[float | None, Option(help="Then multiplied by: recipe's unit for one raw unit.")] = None,
    dbc: Annotated[Path | None, Option(help="Messages of recorded CAN frames.")] = None,
    serial: Annotated[str | None, Option(help="Serial number; left out: the file's name.")] = None,
    runs: Annotated[bool, Option("--runs", help="Several files are runs of one unit, not units.")] = False,
    units: Annotated[bool, Option("--units", help="Several files are units, even if each holds one pose.")] = False,
    json: Annotated[bool, Option("--json", help="What was understood as one JSON document.")] = False,
) -> int:
    """Read any recording or table of readings, print what was understood, and write a samples table.

    Axes, time, unit, rate, temperature and labels are recognised; options state what is not.

        station import turned.csv --out turned.parquet
        station calibrate --samples turned.parquet --recipe hand-held

    Files of one pose each are the visits of one unit:

        station import z-up.csv z-down.csv y-up.csv y-down.csv x-up.csv x-down.csv --out faces.parquet

    Readings without stamps, in blocks of 100, one orientation each:

        station import log.txt --columns 0,1,2 --rate 50 --blocks 100 --out blocks.csv

    Two recordings of one unit, raw, for `segment`:

        station import cold.mat warm.mat --runs --serial SN0042 --raw --out raw.parquet
    """
    from station.cli._import import ImportJob, import_files
    from station.domain.recognition.raw_table import ImportOptions

    places = None if columns is None else tuple(c.strip() for c in columns.split(","))
    options = ImportOptions(
        places, time_unit, rate, temperature, labels, blocks=blocks, unit=unit, zero=zero, scale=scale
    )
    return import_files(files, ImportJob(options, recipe, dbc, serial, runs, units=units), out, raw=raw, as_json=json)
