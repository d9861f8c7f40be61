"""`station calibrate`: a samples table and a recipe, no device."""

from pathlib import Path
from typing import Annotated

from typer import Option


def command(
    recipe: Annotated[str, Option(help="Recipe: a file, or its name in recipes/.")],
    samples: Annotated[Path | None, Option(help="Samples table: .csv or .parquet.")] = None,
    db: Annotated[
        list[Path] | None,
        Option(help="Stored units instead: a log, postgresql://…, or a folder of `export --parquet`; repeatable."),
    ] = None,
    json: Annotated[Path | None, Option(help="Write station.calibration/1 there; - is standard output.")] = None,
    budget: Annotated[bool, Option("--budget", help="Print every unit's uncertainty budget.")] = False,
    compare_models: Annotated[
        bool, Option("--compare-models", help="Would quadratic or cubic terms explain more?")
    ] = False,
    pictures: Annotated[Path | None, Option(help="Folder for pictures (SVG) of every unit.")] = None,
    of: Annotated[str | None, Option(help="With --db: attempts made with this recipe; left out: the same.")] = None,
    processes: Annotated[int | None, Option(min=1, max=256, help="With --db; left out: one a processor.")] = None,
    scheduler: Annotated[str | None, Option(help="With --db: a Dask cluster's, tcp://… or tls://… .")] = None,
    results: Annotated[Path | None, Option(help="With --db: folder for a row a unit; a new start goes on.")] = None,
) -> int:
    """Calibrate from a samples table: coefficients, uncertainty, residual and tilt of each position, verdict.

    For every unit in the table, through the same code as the run:

        station calibrate --samples samples.csv --recipe six-point --json result.json

    With the budget of every coefficient and pictures to look at:

        station calibrate --samples samples.parquet --recipe tilt-24 --budget --pictures pictures

    A fleet's stored units from their reduced visits, one row each as Parquet (docs/cluster.md):

        station calibrate --db station.db --recipe six-point --results fleet
    """
    from station.errors import UsageError

    if (samples is None) == (not db):
        raise UsageError("calibrate-without-samples")
    if db:
        from station.cli._calibrate_fleet import calibrate_fleet
        from station.cli._fleet import FleetRequest

        if budget or compare_models or pictures:
            raise UsageError("calibrate-fleet-options")
        return calibrate_fleet(recipe, of, FleetRequest(tuple(db), processes, scheduler, results), json)
    from station.cli._calibrate import CalibrateOutputs, calibrate_file

    if samples is None or of or processes or scheduler or results:
        raise UsageError("calibrate-samples-options")
    wanted = CalibrateOutputs(json, pictures, budget=budget, compare_models=compare_models)
    return calibrate_file(samples, recipe, wanted)
