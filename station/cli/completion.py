"""`station completion`: commands and options at the press of Tab."""

from typing import Annotated

from typer import Argument


def command(shell: Annotated[str, Argument(help="bash, zsh or fish.")] = "bash") -> int:
    """Print a script that completes commands and options in a shell.

    For this session of bash; in ~/.bashrc for all of them:

        station completion bash > station-completion.bash
        source station-completion.bash

    For zsh and fish:

        station completion zsh > _station
        station completion fish > station.fish
    """
    from station.cli._completion import script
    from station.cli._output import print_raw

    print_raw(script(shell).rstrip("\n"))
    return 0
