"""`station ship`: this station's records on their way to the plant."""

from typing import Annotated

from typer import Option

from station.cli._options import ConfigPath, LogPath

#: Options that only go with one of these words.
GOES_WITH = {"--json": ("--once", "--status")}
#: Options that none of these words may stand beside.
APART = {"--once": ("--status",)}


def command(
    once: Annotated[bool, Option("--once", help="Ship what there is, then end.")] = False,
    status: Annotated[bool, Option("--status", help="Say how far each plant has the log, and end.")] = False,
    json: Annotated[bool, Option("--json", help="With --once or --status: one JSON document.")] = False,
    db: LogPath = None,
    config: ConfigPath = None,
) -> int:
    """Follow the log and bring its records to the plants of config.yaml, in order, until it is stopped.

    No run waits for it: it only reads. A plant that is away gets everything when it is back. In config.yaml:

        receivers: [{url: "https://plant:8443", token_file: plant.token, authority: plant-ca.pem}]

    In the background, beside runs and page, until Ctrl-C:

        station ship --config shipping.yaml

    Exit code 1 of --once and --status: a plant refused a record, 3: it is away; nothing is lost, the log has it all.
    """
    from station.cli._ship import ship, show_status

    return show_status(db, config, as_json=json) if status else ship(db, config, once=once, as_json=json)
