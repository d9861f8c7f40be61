"""`station export`: what the log keeps, for other programs."""

from pathlib import Path
from typing import Annotated

from typer import Option

from station.cli._options import AsJson, ConfigPath, LogPath


def command(
    samples: Annotated[Path | None, Option(help="Samples table to write: .parquet or .csv.")] = None,
    results: Annotated[Path | None, Option(help="One row an attempt to write: .parquet, .csv or .json.")] = None,
    frames: Annotated[Path | None, Option(help="Raw CAN frames to write: .log (candump) or .blf, with marks.")] = None,
    parquet: Annotated[
        Path | None, Option(help="Folder of tables for a fleet, by product and day: attempts, coefficients, visits.")
    ] = None,
    wsjf: Annotated[Path | None, Option(help="Folder of WATS reports (WSJF): a file an ended attempt.")] = None,
    json: AsJson = False,
    db: LogPath = None,
    config: ConfigPath = None,
    serial: Annotated[list[str] | None, Option(help="Only this unit; repeatable.")] = None,
    attempt: Annotated[list[str] | None, Option(help="Only this attempt, by its id; repeatable.")] = None,
    recipe: Annotated[str | None, Option(help="Attempts with this recipe, by name.")] = None,
    station: Annotated[str | None, Option(help="Attempts at this station.")] = None,
    nest: Annotated[str | None, Option(help="Attempts in this nest.")] = None,
    lot: Annotated[str | None, Option(help="Attempts of this lot.")] = None,
    outcome: Annotated[str | None, Option(help="PASS, FAIL, ERROR, ABORTED or INTERRUPTED.")] = None,
    since: Annotated[str | None, Option(help="Begun then or later: 2026-11-21, 2026-11-21T13:00, 7d.")] = None,
    until: Annotated[str | None, Option(help="Begun before.")] = None,
) -> int:
    """Write samples, results and raw frames of stored attempts into files.

    Everything of the last week, for a notebook:

        station export --since 7d --samples week.parquet --results week.csv

    The raw frames of one unit with marks, so that `station replay` computes the same coefficients again:

        station export --serial SN0042 --frames SN0042.log

    Everything as tables for DuckDB, Polars and pandas, from the station's log or from the plant (docs/fleet-tables.md):

        station export --parquet fleet --db postgresql:///plant

    A WATS report of each attempt, passed or not:

        station export --since 1d --wsjf wats

    Beside each file stands FILE.export.json with the file's SHA-256 and the head of the log it came from.
    """
    from station.cli import _export
    from station.cli._log_options import open_named_log, parse_outcome, parse_span_ns
    from station.errors import UsageError
    from station.ports.log_reader import Query

    since_ns, until_ns = parse_span_ns(since, until)
    query = Query(
        station=station,
        nest=nest,
        lot=lot,
        recipe_name=recipe,
        outcome=parse_outcome(outcome),
        since_ns=since_ns,
        until_ns=until_ns,
    )
    wanted = _export.ExportFiles(samples, results, frames)
    with open_named_log(db, config) as log:
        folders = [option for option, given in (("--parquet", parquet), ("--wsjf", wsjf)) if given is not None]
        if folders and not (len(folders) == 1 and samples is results is frames is None):
            raise UsageError("export-folder-alone", option=folders[0])
        found = _export.select_attempts(log, query, serial or [], attempt or [])
        if parquet is not None:
            from station.cli._fleet_tables import export_fleet

            return export_fleet(log, found, parquet, json)
        if wsjf is not None:
            from station.cli._wsjf_reports import export_wsjf

            return export_wsjf(log, found, wsjf, json)
        return _export.export(log, found, wanted, as_json=json)
