"""`station audit`: the auditor's questions to the log."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from station.cli._options import AsJson, ConfigPath, LogPath

#: Options that only go with one of these words.
GOES_WITH = {"--key": ("--verify",), "--head": ("--verify",)}
#: Options that none of these words may stand beside.
APART = dict.fromkeys(("--verify", "--recompute", "--limit", "--key", "--head", "--json"), ("--bundle",))


def command(
    serial: Annotated[str | None, Argument(help="Serial number of a unit; * and ? stand for others.")] = None,
    verify: Annotated[bool, Option("--verify", help="Check the whole log's chain of hashes.")] = False,
    recompute: Annotated[
        bool, Option("--recompute", help="Refit from the stored raw frames and compare bit for bit.")
    ] = False,
    json: AsJson = False,
    db: LogPath = None,
    config: ConfigPath = None,
    recipe: Annotated[str | None, Option(help="Attempts with this recipe, by name.")] = None,
    recipe_hash: Annotated[str | None, Option(help="Attempts with exactly this recipe.")] = None,
    station: Annotated[str | None, Option(help="Attempts at this station.")] = None,
    nest: Annotated[str | None, Option(help="Attempts in this nest.")] = None,
    lot: Annotated[str | None, Option(help="Attempts of this lot.")] = None,
    operator: Annotated[str | None, Option(help="Attempts by this operator.")] = None,
    software: Annotated[str | None, Option(help="Attempts by this version of the station.")] = None,
    firmware: Annotated[str | None, Option(help="Attempts on devices with this software (0x100A).")] = None,
    outcome: Annotated[str | None, Option(help="PASS, FAIL, ERROR, ABORTED or INTERRUPTED.")] = None,
    since: Annotated[str | None, Option(help="Begun then or later: 2026-11-21, 2026-11-21T13:00, 7d.")] = None,
    until: Annotated[str | None, Option(help="Begun then or before; a day counts whole.")] = None,
    recipe_version: Annotated[int | None, Option(min=0, help="Attempts with this version of the recipe.")] = None,
    fixture: Annotated[str | None, Option(help="Attempts on this fixture, as config.yaml calls it.")] = None,
    reference: Annotated[str | None, Option(help="Attempts against this reference: serial or certificate.")] = None,
    check: Annotated[str | None, Option(help="Attempts that this limit failed: gain, offset, stuck, ...")] = None,
    bundle: Annotated[Path | None, Option(help="Write the evidence of the unit's newest attempt into one ZIP.")] = None,
    limit: Annotated[int | None, Option(min=1, help="At most so many attempts, the newest.")] = None,
    key: Annotated[Path | None, Option(help="With --verify: the station's public key, PEM.")] = None,
    head: Annotated[str | None, Option(help="With --verify: NUMBER:HASH from a certificate or export.")] = None,
) -> int:
    """Show everything ever done to a unit, find attempts, check the log.

    One unit's whole life, then the same computed again from its raw frames:

        station audit SN0042
        station audit SN0042 --recompute

    All units made with a recipe in a nest in the last week:

        station audit --recipe six-point --nest A --since 7d

    Every unit whose gain failed, and one unit's evidence as one file that Python alone can check:

        station audit --check gain --since 2026-11-01
        station audit SN0042 --bundle SN0042.zip

    Was anything in the log edited, deleted, inserted, reordered or cut off:

        station audit --verify
    """
    from station.cli import _audit, _bundle
    from station.cli._log_options import open_named_log, parse_check, parse_head, parse_outcome, parse_span_ns
    from station.ports.log_reader import Query, serial_filter

    named = serial_filter(serial)
    since_ns, until_ns = parse_span_ns(since, until)
    query = Query(
        serial=named.get("serial"),
        serial_from=named.get("serial_from"),
        serial_like=named.get("serial_like"),
        recipe_version=recipe_version,
        fixture=fixture,
        reference=reference,
        check=parse_check(check),
        station=station,
        nest=nest,
        lot=lot,
        operator=operator,
        software=software,
        recipe_name=recipe,
        recipe_hash=recipe_hash,
        firmware=firmware,
        outcome=parse_outcome(outcome),
        since_ns=since_ns,
        until_ns=until_ns,
    )
    with open_named_log(db, config) as log:
        if bundle is not None:
            return _bundle.write_bundle(log, query, bundle)
        known = parse_head(head)
        request = _audit.AuditRequest(query, limit, verify, recompute, key=key, known=known, config=config)
        return _audit.run_audit(log, request, as_json=json)
