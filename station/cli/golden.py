"""`station golden`: golden and known-bad units."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from station.cli._options import AsJson, ConfigPath, LogPath

#: Options that only go with one of these words.
GOES_WITH = {
    "--bad": ("register",), "--within": ("register",), "--value": ("register",), "--due": ("register",),
    "--recipe": ("--value",), "--svg": ("trend",),
}  # fmt: skip


def command(
    action: Annotated[str, Argument(help="register, remove, check, trend or list.")],
    serial: Annotated[str | None, Argument(help="The unit (register, remove, trend).")] = None,
    bad: Annotated[bool, Option("--bad", help="register: it must FAIL, for the same reasons.")] = False,
    within: Annotated[
        float | None, Option(min=0.001, max=1, help="register: half-width, as a share of the limits; left out: 0.1.")
    ] = None,
    value: Annotated[
        list[str] | None,
        Option(help="register: NAME=VALUE:U of its certificate, as 'gain z=1.0021:0.0004'; Eₙ decides."),
    ] = None,
    due: Annotated[str, Option(help="register: day by which the unit itself is due, 2027-01-31.")] = "",
    recipe: Annotated[
        str, Option(help="register, with --value: the recipe whose serials these are; left out: config.yaml's.")
    ] = "",
    svg: Annotated[Path | None, Option(help="trend: drawing to write.")] = None,
    json: AsJson = False,
    db: LogPath = None,
    config: ConfigPath = None,
) -> int:
    """Register units whose result is known; the station makes nothing while their check is due or failed.

    config.yaml says that they are wanted, and how often: `golden: {file: golden.json, every_h: 8}`.
    Register a unit by the values and U of its certificate, before its first run:

        station golden register SN9001 --value "gain z=1.0053:0.002" --due 2035-06-30

    Without a certificate, register what its last run came to:

        station golden register SN9003 --due 2035-06-30
        station golden register SN9002 --bad

    Before each shift, run them alone, then see where they stand:

        station run --serial SN9001 --serial SN9002
        station golden check

    How Eₙ went over every attempt of a certified unit, and when a drift reaches 1:

        station golden trend SN9001 --svg trend.svg
    """
    from station.cli._golden import RegisterOptions, manage_golden_units

    options = RegisterOptions(bad, within, due, tuple(value or ()), recipe, svg)
    return manage_golden_units(action, serial, options, (db, config), as_json=json)
