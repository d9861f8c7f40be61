"""`station calibrate`: a samples table and a recipe, no device."""

from pathlib import Path
from typing import Annotated

from typer import Option


def command(
    samples: Annotated[Path, Option(help="Samples table: .csv or .parquet.")],
    recipe: Annotated[str, Option(help="Recipe: a file, or its name in recipes/.")],
    json: Annotated[Path | None, Option(help="Write station.calibration/1 there; - is standard output.")] = None,
    budget: Annotated[bool, Option("--budget", help="Print every unit's uncertainty budget.")] = False,
    compare_models: Annotated[
        bool, Option("--compare-models", help="Would quadratic or cubic terms explain more?")
    ] = False,
    pictures: Annotated[Path | None, Option(help="Folder for pictures (SVG) of every unit.")] = None,
) -> int:
    """Calibrate from a samples table: coefficients, uncertainty, residual and tilt of each position, verdict.

    For every unit in the table, through the same code as the run:

        station calibrate --samples samples.csv --recipe six-point --json result.json

    With the budget of every coefficient and pictures to look at:

        station calibrate --samples samples.parquet --recipe tilt-24 --budget --pictures pictures
    """
    from station.cli._calibrate import CalibrateOutputs, calibrate_file

    wanted = CalibrateOutputs(json, pictures, budget=budget, compare_models=compare_models)
    return calibrate_file(samples, recipe, wanted)
