"""`station stop`: ends the present run."""

from pathlib import Path
from typing import Annotated

from typer import Option

from station.cli._options import AsJson, ConfigPath

#: Options that only go with one of these words.
GOES_WITH = {"--accounts": ("--kill",)}


def command(
    db: Annotated[Path | None, Option(help="The log that the run writes; left out: as config.yaml says.")] = None,
    config: ConfigPath = None,
    kill: Annotated[bool, Option("--kill", help="End the process at once; nothing is parked. Needs --by.")] = False,
    by: Annotated[str | None, Option(help="With --kill: the engineer whose password stands for it.")] = None,
    accounts: Annotated[Path | None, Option(help="File of the people; left out: accounts.json beside the log.")] = None,
    json: AsJson = False,
) -> int:
    """Stop the present run, whoever started it: it parks the fixture, closes its records and ends.

    It needs neither the page nor a network. The run's user and group may stop it, and root:

        station stop

    Where several stations write logs on this machine, name the log:

        station stop --db station.db

    Where no run is in progress there is nothing to stop: it says so, and that is no error.

    A stop asked for twice is one stop: no number of them breaks off parking or the return of old values. Where a run
    does not end for all that, an engineer ends its process with --kill --by NAME: the fixture stays where it is, and
    the next start finds what was left half done.
    """
    from station.cli import _output
    from station.cli._kill import KillRequest, kill_run
    from station.config.settings import load_settings
    from station.errors import LogError, UsageError
    from station.messages import Message
    from station.panel_protocol.stop import request_stop

    database = db or Path(load_settings(config).database)
    if kill or by is not None:
        return kill_run(database, KillRequest(kill, by, accounts, json))
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
