"""`station demo`: a tour without hardware and without questions."""

from pathlib import Path
from typing import Annotated

from typer import Argument


def command(
    folder: Annotated[Path, Argument(help="Folder to make; it must be new or empty.")] = Path("station-demo"),
) -> int:
    """Take a tour: a good load, a bad load, a hidden effect, the audit; it leaves a folder to try everything in.

    In about half a minute, without hardware and without questions:

        station demo

    In that folder every example of every --help runs as it stands: its config.yaml describes a rehearsal bench, where
    bus, rig and devices are simulated, and its log holds units that passed, units that failed and a cause to find.
    """
    from station.cli._demo import take_tour

    return take_tour(folder)
