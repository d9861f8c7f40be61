"""`station doctor`: is everything there that a run needs?"""

from pathlib import Path
from typing import Annotated

from typer import Option


def command(
    recipe: Annotated[str | None, Option(help="Recipe: a file, or its name in recipes/.")] = None,
    config: Annotated[Path | None, Option(help="Station settings; left out: ./config.yaml.")] = None,
    db: Annotated[Path | None, Option(help="The log; left out: as config.yaml says.")] = None,
    simulate: Annotated[bool, Option("--simulate", help="Leave out what only a real bus needs.")] = False,
    json: Annotated[bool, Option("--json", help="One JSON document on standard output.")] = False,
) -> int:
    """Look at bus, rights, clock, disk, DBC, device map, key and golden units; say what to do about each.

    Before the first shift, and whenever something is odd:

        station doctor

    On a desk without a bus:

        station doctor --simulate --recipe tilt-24
    """
    from station.cli._doctor import DoctorRequest, run_checks

    return run_checks(DoctorRequest(recipe, config, db, simulate), as_json=json)
