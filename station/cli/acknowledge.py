"""`station acknowledge`: go on with a log that its heads speak against, or with accounts that were edited."""

from pathlib import Path
from typing import Annotated

from typer import Option

from station.cli._options import ConfigPath, LogPath


def command(
    by: Annotated[str, Option(help="Who takes note.")],
    reason: Annotated[str, Option(help="Why it is right to go on.")],
    db: LogPath = None,
    config: ConfigPath = None,
) -> int:
    """Go on with a log that is not as it was left, or with accounts of the page that were edited in their file.

    A run refuses a log that was restored, cut off, or has lost its head file; the page refuses people whose account is
    not the one that the log has sealed. What speaks against them, your name and your reason are sealed into the log,
    and `station audit --verify` shows them for ever:

        station acknowledge --by "Ada Lovelace" --reason "restored from the backup of Monday, disk failure"
    """
    from station.cli._output import print_line
    from station.config.settings import load_settings
    from station.errors import UsageError
    from station.messages import Message, render
    from station.wiring.acknowledge import acknowledge

    if not by.strip() or not reason.strip():
        raise UsageError("acknowledge-without-words")
    settings = load_settings(config)
    path = db or Path(settings.database)
    found = acknowledge(path, settings, by.strip(), reason.strip())
    done = Message("acknowledged", path=str(path), findings=found)
    print_line(render(done if found else Message("nothing-to-acknowledge", path=str(path))))
    return 0
