"""`station check`: everything that can be known of a recipe before anything moves."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from station.cli._options import AsJson, ConfigPath

#: Options that none of these words may stand beside.
APART = {"--design": ("--product",), "--order": ("--product",), "--config": ("--product",), "--db": ("--product",)}


def command(
    recipe: Annotated[str | None, Argument(help="Recipe: a file, or its name in recipes/.")] = None,
    product: Annotated[str | None, Option(help="Check a product alone: a file, or its name in dbc/.")] = None,
    design: Annotated[
        int | None, Option(min=3, max=200, help="Propose that many positions for the recipe's method.")
    ] = None,
    order: Annotated[bool, Option("--order", help="Put the positions into the order of least moving time.")] = False,
    config: ConfigPath = None,
    db: Annotated[Path | None, Option(help="The log that tells the cycle time; left out: as config.yaml says.")] = None,
    json: AsJson = False,
) -> int:
    """Check a recipe before anything moves: coefficients, uncertainty, limits, cycle time, what to add.

    Predicted standard deviation of every coefficient, which limits can be decided, the next best position:

        station check tilt-24

    Twelve positions for the method of a recipe, as YAML to paste:

        station check six-point --design 12

    The positions of a recipe in the order of least moving time, as YAML to paste:

        station check tilt-24 --order

    A product without a recipe: roles of the signals, device map against the EDS:

        station check --product accelerometer
    """
    from station.cli._check import RecipeCheckRequest, check_recipe
    from station.cli._check_product import check_product_alone
    from station.errors import UsageError

    if (recipe is None) == (product is None):
        raise UsageError("check-recipe-or-product")
    if product is not None:
        return check_product_alone(product, as_json=json)
    assert recipe is not None
    return check_recipe(RecipeCheckRequest(recipe, design, config, db, order=order), as_json=json)
