"""`station sign`: a person's signature under an attempt."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from station.cli._options import ConfigPath, LogPath


def command(
    serial: Annotated[str, Argument(help="Serial number of the unit.")],
    by: Annotated[str, Option(help="Who signs: a person of the page, as `station panel --add` made them.")],
    meaning: Annotated[str, Option(help="What the signature states: reviewed or released.")],
    attempt: Annotated[str | None, Option(help="Attempt to sign; left out: the unit's newest.")] = None,
    comment: Annotated[str, Option(help="A remark that is sealed with it.")] = "",
    db: LogPath = None,
    config: ConfigPath = None,
    accounts: Annotated[Path | None, Option(help="File of the people; left out: accounts.json beside the log.")] = None,
) -> int:
    """Sign an attempt: reviewed, or released. It asks for the password, whoever is logged in.

    Name, role, time, meaning and the seal of the attempt's end go into the log; `audit`, the unit's page and its
    certificate show them. Engineers and auditors may sign; only what passed can be released:

        station sign SN0042 --by "Ada Lovelace" --meaning released

    In a pipe the password is the first line of standard input.
    """
    from station.cli._sign import SignatureRequest, sign_attempt

    request = SignatureRequest(serial, by, meaning, attempt, comment)
    return sign_attempt(request, db, config, accounts)
