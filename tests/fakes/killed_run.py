"""`python -m tests.fakes.killed_run FOLDER PORT METHOD N [RECIPE]`: a simulated run that dies at the n-th call.

PORT and METHOD name what is called (store write, device download …); death comes before the call (N > 0) or just
after it (N < 0). Exit code 137 says that it died, 0 that the run ended before.
"""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from station.adapters.canopen.canopen_device import CanopenDevice
from station.adapters.object_access.device import ObjectDevice
from station.adapters.store.sqlite import SqliteStore
from tests.fakes import fixture_run

PORTS = {"store": SqliteStore, "device": CanopenDevice, "object-device": ObjectDevice}


def deadly(call: Callable[..., object], number: int) -> Callable[..., object]:
    """The call, which ends the process at its n-th time."""
    left = abs(number)

    def dying(*args: object, **kwargs: object) -> object:
        nonlocal left
        left -= 1
        if left == 0 and number > 0:
            os._exit(137)
        result = call(*args, **kwargs)
        if left == 0:
            os._exit(137)
        return result

    return dying


def main() -> None:
    """See the top of the file."""
    folder, port, method, number, *recipe = sys.argv[1:]
    kind = PORTS[port]
    setattr(kind, method, deadly(getattr(kind, method), int(number)))
    order: dict[str, Any] = {"recipe": recipe[0]} if recipe else {}
    fixture_run.run(Path(folder), seed=2, **order)


if __name__ == "__main__":
    main()
