"""`station backtest`: what a changed recipe would have made of the units in the log."""

from pathlib import Path
from typing import Annotated

from typer import Option

from station.cli._options import AsJson, ConfigPath

#: Options that none of these words may stand beside: a source that is named needs no settings.
APART = {"--config": ("--db",)}


def command(
    recipe: Annotated[str, Option(help="The changed recipe: a file, or its name in recipes/.")],
    of: Annotated[str | None, Option(help="Attempts made with this recipe; left out: of the same name.")] = None,
    from_frames: Annotated[
        bool, Option("--from-frames", help="Compute from raw frames; by itself where settle or dwell changed.")
    ] = False,
    json: AsJson = False,
    db: Annotated[
        list[Path] | None,
        Option(help="A log, postgresql://…, or a folder of `export --parquet`; repeatable; left out: config.yaml's."),
    ] = None,
    config: ConfigPath = None,
    nest: Annotated[str | None, Option(help="Only attempts in this nest.")] = None,
    lot: Annotated[str | None, Option(help="Only attempts of this lot.")] = None,
    since: Annotated[str | None, Option(help="Begun then or later: 2026-11-21, 2026-11-21T13:00, 7d.")] = None,
    until: Annotated[str | None, Option(help="Begun before.")] = None,
    processes: Annotated[int | None, Option(min=1, max=256, help="Left out: one a processor.")] = None,
    scheduler: Annotated[str | None, Option(help="A Dask cluster's scheduler: tcp://… or tls://… .")] = None,
    results: Annotated[
        Path | None, Option(help="Folder that keeps the results as Parquet; a new start goes on.")
    ] = None,
) -> int:
    """Compute stored units again under a changed recipe, method or limits, and show what would change.

    Would tighter limits have failed units of the last month:

        station backtest --recipe six-point-tighter.yaml --of six-point --since 30d

    So that a stopped command goes on where it was; with --scheduler tcp://host:8786 on a cluster (docs/cluster.md):

        station backtest --recipe six-point --db station.db --results fleet

    Reduced visits (means with their covariances) are computed from where settling and dwell are as they were; then
    what only raw samples show, such as clipping, is taken over as it was found.
    """
    from station.cli import _backtest
    from station.cli._fleet import FleetRequest, named_sources
    from station.cli._log_options import parse_span_ns
    from station.config.recipes import load_recipe
    from station.ports.log_reader import Query

    changed = load_recipe(recipe)
    since_ns, until_ns = parse_span_ns(since, until)
    query = Query(
        recipe_name=of or changed.name,
        nest=nest,
        lot=lot,
        since_ns=since_ns,
        until_ns=until_ns,
    )
    fleet = FleetRequest(named_sources(db, config), processes, scheduler, results)
    return _backtest.run_backtest(_backtest.BacktestRequest(changed, query, from_frames, fleet), as_json=json)
