"""`station stop`: ends the present run."""

from pathlib import Path
from typing import Annotated

from typer import Option

from station.cli._options import AsJson, ConfigPath


def command(
    db: Annotated[Path | None, Option(help="The log that the run writes; left out: as config.yaml says.")] = None,
    config: ConfigPath = None,
    json: AsJson = False,
) -> int:
    """Stop the present run, whoever started it: it parks the fixture, closes its records and ends.

    It needs neither the page nor a network. The run's user and group may stop it, and root:

        station stop

    Where several stations write logs on this machine, name the log:

        station stop --db station.db

    Where no run is in progress there is nothing to stop: it says so, and that is no error.
    """
    from station.cli import _output
    from station.config.settings import load_settings
    from station.errors import LogError, UsageError
    from station.messages import Message
    from station.panel_protocol.stop import request_stop

    database = db or Path(load_settings(config).database)
    try:
        pid: int | None = request_stop(database)
    except UsageError:  # nothing to stop is no error
        pid = None
    if pid is None and not database.exists():
        raise LogError("stop-without-log", path=str(database))
    if json:
        _output.print_json({"schema": "station.stop/1", "database": str(database), "pid": pid})
    else:
        _output.print_message(Message("no-run-under-way") if pid is None else Message("stop-requested", pid=pid))
    return 0
