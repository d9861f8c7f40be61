"""`station doctor`: is everything there that a run needs?"""

from typing import Annotated

from typer import Option

from station.cli._options import AsJson, ConfigPath, LogPath


def command(
    recipe: Annotated[str | None, Option(help="Recipe: a file, or its name in recipes/.")] = None,
    config: ConfigPath = None,
    db: LogPath = None,
    simulate: Annotated[bool, Option("--simulate", help="Leave out what only a real bus needs.")] = False,
    json: AsJson = False,
) -> int:
    """Look at bus, rights, clock, disk, DBC, device map, key and golden units; say what to do about each.

    Before the first shift, and whenever something is odd:

        station doctor

    On a desk without a bus:

        station doctor --simulate --recipe tilt-24
    """
    from station.cli._doctor import DoctorRequest, run_checks

    return run_checks(DoctorRequest(recipe, config, db, simulate), as_json=json)
