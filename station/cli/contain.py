"""`station contain`: which units a nest, fixture, reference, lot, recipe or time touched."""

from typing import Annotated

from typer import Option

from station.cli._options import AsJson, ConfigPath, LogPath


def command(
    nest: Annotated[str | None, Option(help="Units that were in this nest.")] = None,
    fixture: Annotated[str | None, Option(help="Units on this fixture, as config.yaml calls it.")] = None,
    reference: Annotated[str | None, Option(help="Units against this reference: serial or certificate.")] = None,
    lot: Annotated[str | None, Option(help="Units of this lot.")] = None,
    recipe: Annotated[str | None, Option(help="Units made with this recipe, by name.")] = None,
    recipe_version: Annotated[int | None, Option(min=0, help="With this version of it.")] = None,
    station: Annotated[str | None, Option(help="Units of this station.")] = None,
    operator: Annotated[str | None, Option(help="Units of this operator.")] = None,
    software: Annotated[str | None, Option(help="Units of this version of the station.")] = None,
    firmware: Annotated[str | None, Option(help="Units with this firmware.")] = None,
    check: Annotated[str | None, Option(help="Units that this limit failed: gain, offset, stuck, ...")] = None,
    since: Annotated[str | None, Option(help="Begun then or later: 2026-11-21, 2026-11-21T13:00, 7d.")] = None,
    until: Annotated[str | None, Option(help="Begun then or before; a day counts whole.")] = None,
    json: AsJson = False,
    db: LogPath = None,
    config: ConfigPath = None,
) -> int:
    """List every unit that something touched, and how each stands now: what a recall needs.

    Nest B had a worn contact on one morning; which units saw it, and did they pass elsewhere afterwards:

        station contain --nest B --since 2026-11-21T06:00 --until 2026-11-21T12:00

    Everything that was measured against a reference, as one serial a line:

        station contain --reference GOLD-7 --json
    """
    from station.cli import _contain
    from station.cli._log_options import open_named_log, parse_check, parse_span_ns
    from station.ports.log_reader import Query

    since_ns, until_ns = parse_span_ns(since, until)
    query = Query(
        nest=nest,
        fixture=fixture,
        reference=reference,
        lot=lot,
        recipe_name=recipe,
        recipe_version=recipe_version,
        station=station,
        operator=operator,
        software=software,
        firmware=firmware,
        check=parse_check(check),
        since_ns=since_ns,
        until_ns=until_ns,
    )
    with open_named_log(db, config) as log:
        return _contain.contain(log, query, as_json=json)
