"""`station diagnose`: what the simulation gets wrong."""

import os
from pathlib import Path
from typing import Annotated

from typer import Option


def command(
    recipe: Annotated[str, Option(help="Recipe: a file, or its name in recipes/.")],
    samples: Annotated[
        Path | None, Option(help="Samples: .csv or .parquet; or a CAN log with marks, as `replay` reads it.")
    ] = None,
    db: Annotated[
        list[Path] | None,
        Option(help="A station's log instead of a samples table; with --shared, any number of sources."),
    ] = None,
    since: Annotated[
        str | None, Option(help="With --db: from this day or time on, 2026-03-01 or 2026-03-01T06:00.")
    ] = None,
    model: Annotated[Path | None, Option(help="The simulation to compare with, station.model/1.")] = None,
    json: Annotated[Path | None, Option(help="Write station.diagnosis/1 there; - is standard output.")] = None,
    report: Annotated[Path | None, Option(help="Write a report for people, one HTML file.")] = None,
    figures: Annotated[Path | None, Option(help="Folder for the report's figures, one SVG file each.")] = None,
    extend: Annotated[Path | None, Option(help="Write the simulation extended by what was found.")] = None,
    next_run: Annotated[Path | None, Option("--next-run", help="Write the recipe of the next run proposed.")] = None,
    seed: Annotated[int, Option(min=0, help="Seed of the bootstrap.")] = 1,
    shared: Annotated[
        bool, Option("--shared", help="With --db: which stations, nests, lots and positions of a fleet share a cause.")
    ] = False,
    processes: Annotated[int | None, Option(min=1, max=256, help="With --shared; left out: one a processor.")] = None,
    scheduler: Annotated[str | None, Option(help="With --shared: a Dask cluster's, tcp://… or tls://… .")] = None,
    results: Annotated[Path | None, Option(help="With --shared: folder of the portions; a new start goes on.")] = None,
) -> int:
    """Show what the simulation gets wrong, name the cause, and measure what knowing it gains.

    Exit code 0: the simulation accounts for the data; 1: something was found.

        station diagnose --samples samples.parquet --recipe tilt-24 --report report.html

    The station's own log, from some day on:

        station diagnose --db station.db --recipe n-point --since 7d

    With the cause built into the simulation, a second look is silent:

        station diagnose --samples samples.parquet --recipe tilt-24 --extend model.yaml
        station diagnose --samples samples.parquet --recipe tilt-24 --model model.yaml

    `--shared --db postgresql:///plant` says over a fleet of any size who shares a cause, and since when
    (docs/fleet-diagnosis.md).
    """
    # Many small matrices: a second thread of the linear algebra only waits for the first.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from station.errors import UsageError

    if shared:
        from station.cli._diagnose_fleet import diagnose_fleet
        from station.cli._fleet import FleetRequest

        if not db or any((samples, model, report, figures, extend, next_run)):
            raise UsageError("diagnose-shared-options")
        return diagnose_fleet(recipe, since, FleetRequest(tuple(db), processes, scheduler, results), json)
    if processes or scheduler or results or len(db or ()) > 1:
        raise UsageError("diagnose-not-shared")
    from station.cli._diagnose import DiagnoseOutputs, run_diagnose

    wanted = DiagnoseOutputs(json, report, figures, extend, next_run)
    return run_diagnose(samples, db[0] if db else None, since, recipe, model, wanted, seed)
