"""`station report`: the line in charts."""

from pathlib import Path
from typing import Annotated

from typer import Option

from station.cli._options import AsJson, ConfigPath, LogPath


def command(
    out: Annotated[Path | None, Option(help="HTML file to write, self-contained.")] = None,
    value: Annotated[
        str, Option(help="What the control chart follows: 'offset x', 'gain z', 'residual rms', …")
    ] = "offset x",
    size: Annotated[int, Option(min=1, max=25, help="Attempts in a subgroup: 1 I-MR, 2-9 X̄-R, 10 and more X̄-s.")] = 1,
    station: Annotated[str | None, Option(help="Only this station.")] = None,
    nest: Annotated[str | None, Option(help="Only this nest.")] = None,
    recipe: Annotated[str | None, Option(help="Only this recipe, by name.")] = None,
    lot: Annotated[str | None, Option(help="Only this lot.")] = None,
    since: Annotated[str | None, Option(help="Begun then or later: 2026-11-21, 7d.")] = None,
    until: Annotated[str | None, Option(help="Begun before.")] = None,
    most: Annotated[int, Option(min=2, help="At most so many attempts in the control charts, the newest.")] = 2000,
    json: AsJson = False,
    db: LogPath = None,
    config: ConfigPath = None,
) -> int:
    """Report on the line: yields, reasons, cycle time, control charts, capability, health of the fixture.

    The last week as one page to send around:

        station report --since 7d --out week.html

    X̄-R charts of a gain in subgroups of four, as data:

        station report --value "gain z" --size 4 --json
    """
    from station.cli._log_options import open_named_log, parse_span_ns
    from station.cli._report import ReportRequest, run_report
    from station.ports.log_reader import Query

    since_ns, until_ns = parse_span_ns(since, until)
    query = Query(
        station=station,
        nest=nest,
        recipe_name=recipe,
        lot=lot,
        since_ns=since_ns,
        until_ns=until_ns,
    )
    with open_named_log(db, config) as log:
        return run_report(log, ReportRequest(query, value, size, most, out), as_json=json)
