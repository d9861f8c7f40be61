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
    db: Annotated[Path | None, Option(help="The station's log instead of a samples table.")] = None,
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
) -> int:
    """Show what the simulation gets wrong, name the cause, and measure what knowing it gains.

    Exit code 0: the simulation accounts for the data; 1: something was found.

        station diagnose --samples samples.parquet --recipe tilt-24 --report report.html

    The station's own log, from some day on:

        station diagnose --db station.db --recipe n-point --since 7d

    With the cause built into the simulation, a second look is silent:

        station diagnose --samples samples.parquet --recipe tilt-24 --extend model.yaml
        station diagnose --samples samples.parquet --recipe tilt-24 --model model.yaml
    """
    # Many small matrices: a second thread of the linear algebra only waits for the first.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from station.cli._diagnose import DiagnoseOutputs, run_diagnose

    wanted = DiagnoseOutputs(json, report, figures, extend, next_run)
    return run_diagnose(samples, db, since, recipe, model, wanted, seed)
