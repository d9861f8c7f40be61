"""A simulated run that dies at the n-th call.

Port and method name what is called (store write, device download …); death comes before the call (n > 0) or just
after it (n < 0). Exit code 137 says that it died, 0 that the run ended before.
"""

import multiprocessing
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from station.adapters.canopen.canopen_device import CanopenDevice
from station.adapters.object_access.device import ObjectDevice
from station.adapters.store.sqlite import SqliteStore
from station.service.preset_offset import PresetDevice
from tests.fakes import fixture_run

PORTS = {"store": SqliteStore, "device": CanopenDevice, "object-device": ObjectDevice, "preset": PresetDevice}


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


def killed(folder: Path, port: str, method: str, number: int, recipe: str | None = None) -> int | None:
    """The exit code of a run in a process of its own: a fork, which has everything loaded."""
    process = multiprocessing.get_context("fork").Process(target=_run, args=(folder, port, method, number, recipe))
    process.start()
    process.join(100)
    return process.exitcode


def _run(folder: Path, port: str, method: str, number: int, recipe: str | None) -> None:
    kind = PORTS[port]
    setattr(kind, method, deadly(getattr(kind, method), number))
    order: dict[str, Any] = {"recipe": recipe} if recipe else {}
    fixture_run.run(folder, seed=2, **order)
