"""Work for the workers of a cluster, which import it by its name."""

import os
import signal
from pathlib import Path

from station.ports.fleet import Columns
from station.service.backtest import compare_portion
from station.service.fleet import FleetWork

#: Says where a worker leaves word that it was killed once.
MARKER = "STATION_TEST_KILLED"


def kill_once(work: FleetWork) -> Columns:
    """The portion of a backtest; the first worker to come here dies of SIGKILL in the middle of it."""
    marker = Path(os.environ[MARKER])
    if not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return compare_portion(work)


def refuse(work: FleetWork) -> Columns:
    """What a recipe that cannot be computed does to a worker."""
    from station.errors import RecipeError

    raise RecipeError("attempt-without-recipe")


def echo(work: int) -> Columns:
    """A portion that takes next to nothing."""
    return {"work": [work]}
