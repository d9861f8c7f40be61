"""`station panel`: the operator's page."""

from pathlib import Path
from typing import Annotated

from typer import Option

from station.cli._options import ConfigPath, LogPath

#: Options that only go with one of these words.
GOES_WITH = {"--role": ("--add",)}
#: Options that none of these words may stand beside.
APART = dict.fromkeys(
    ("--recipe", "--simulate", "--pace", "--fault", "--host", "--port", "--host-name", "--proxy", "--secure"),
    ("--add", "--remove"),
)


def command(
    recipe: Annotated[str | None, Option(help="Recipe of the runs: a file, or its name in recipes/.")] = None,
    config: ConfigPath = None,
    db: LogPath = None,
    simulate: Annotated[bool, Option("--simulate", help="Runs from the page are simulated ones.")] = False,
    pace: Annotated[float | None, Option(min=0.01, help="With --simulate: so many times real time.")] = None,
    fault: Annotated[
        list[str] | None, Option(help="With --simulate: what is wrong with a device, [SERIAL/]KIND[:key=value,...].")
    ] = None,
    host: Annotated[str, Option(help="Address to listen at; only this machine unless told otherwise.")] = "127.0.0.1",
    port: Annotated[int, Option(min=0, max=65535, help="Port to listen at; 0: any free one.")] = 8080,
    host_name: Annotated[
        list[str] | None, Option(help="A further name of this machine, as browsers are given it; addresses always do.")
    ] = None,
    proxy: Annotated[
        str | None, Option(help="Address of a proxy in front of the page; only its X-Forwarded-For is believed.")
    ] = None,
    secure: Annotated[bool, Option("--secure", help="The page is reached by https only (behind a proxy).")] = False,
    accounts: Annotated[Path | None, Option(help="File of the people; left out: accounts.json beside the log.")] = None,
    add: Annotated[str | None, Option(help="Add this person (or change the password), then end.")] = None,
    remove: Annotated[str | None, Option(help="Remove this person, then end.")] = None,
    role: Annotated[str, Option(help="With --add: operator, engineer or auditor.")] = "operator",
    by: Annotated[str | None, Option(help="With --add or --remove: the engineer whose password stands for it.")] = None,
) -> int:
    """Serve the page for operator, auditor and engineer; it reads the log and starts runs as processes of their own.

    First the people (the password is asked for, or read from standard input):

        station panel --add anna --role engineer

    The log seals who may log in. Once it knows an engineer, a change needs one's password (--by anna): an account
    that was changed otherwise is refused until `station acknowledge`.

    Then the page, at http://127.0.0.1:8080:

        station panel --db station.db

    Without any hardware:

        station panel --simulate --db demo.db

    With --db postgresql:///plant it is the page of a plant: audit, charts and certificates of all stations, read only.
    """
    from station.cli import _panel
    from station.errors import UsageError
    from station.wiring.rehearsal import rehearsing

    where = _panel.PanelFiles(recipe, config, db, accounts)
    if add is not None or remove is not None:
        return _panel.change_accounts(where, _panel.PersonChange(add, remove, role, by))
    if by is not None:
        raise UsageError("panel-by-alone")
    simulated = simulate or rehearsing(config)
    for option, given in (("--fault", fault), ("--pace", pace)):
        if given and not simulated:
            raise UsageError("option-needs-simulate", option=option)
    listen = _panel.ListenAddress(host, port, secure, tuple(host_name or ()), proxy)
    return _panel.serve(where, listen, pace=(pace or 1.0) if simulated else None, faults=tuple(fault or ()))
