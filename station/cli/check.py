"""`station check`: everything that can be known of a recipe before anything moves."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option


def command(
    recipe: Annotated[str, Argument(help="Recipe: a file, or its name in recipes/.")],
    design: Annotated[
        int | None, Option(min=3, max=200, help="Propose that many positions for the recipe's method.")
    ] = None,
    order: Annotated[bool, Option("--order", help="Put the positions into the order of least moving time.")] = False,
    config: Annotated[
        Path | None, Option(help="config.yaml whose positioner tells the moving times; with --order.")
    ] = None,
    json: Annotated[bool, Option("--json", help="One JSON document on standard output.")] = False,
) -> int:
    """Check a recipe before anything moves: coefficients, uncertainty, limits, cycle time, what to add.

    Predicted standard deviation of every coefficient, which limits can be decided, the next best position:

        station check tilt-24

    Twelve positions for the method of a recipe, as YAML to paste:

        station check six-point --design 12

    The positions of a recipe in the order of least moving time, as YAML to paste:

        station check tilt-24 --order
    """
    from station.cli._check import check_recipe

    return check_recipe(recipe, design, order=order, config=config, as_json=json)
