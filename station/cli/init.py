"""`station init`: drafts product, map and recipe of a new device from its DBC and EDS."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from station.cli._options import AsJson


def command(
    name: Annotated[str | None, Argument(help="Name of the product; left out: that of the DBC.")] = None,
    dbc: Annotated[Path | None, Option(help="DBC, KCD, SYM or ARXML with the device's readings.")] = None,
    eds: Annotated[Path | None, Option(help="Its EDS or DCF, where it has one; alone it drafts the DBC.")] = None,
    sensor: Annotated[
        str | None, Option(help="Kind of sensor: accelerometer, gyroscope, magnetometer, inclinometer.")
    ] = None,
    message: Annotated[str | None, Option(help="Message of the DBC that carries the readings.")] = None,
    folder: Annotated[Path, Option(help="Where config.yaml, dbc/ and recipes/ are.")] = Path(),
    run: Annotated[bool, Option(help="Run it on the rehearsal bench at the end.")] = True,
    json: AsJson = False,
) -> int:
    """Draft a product, its device map and a recipe, check them, and run them on the rehearsal bench.

    From the device's own files; what is a guess says `check` in a comment, and nothing is ever written over:

        station init my-sensor --dbc dbc/accelerometer.dbc --eds dbc/accelerometer.eds

    From nothing, a copy of the simulated accelerometer to change:

        station init my-first

    On a terminal it asks for what is not given; in a pipe it takes the likeliest and says so.
    """
    from station.cli._init import InitRequest, draft_product

    return draft_product(InitRequest(name, dbc, eds, sensor, message, folder, runs=run), as_json=json)
