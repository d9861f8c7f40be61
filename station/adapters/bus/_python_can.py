"""python-can without asammdf, and with it pandas, until an MF4 recording is opened; and neither of them heard.

What they log goes nowhere: whoever reads a recording is told in one sentence what is wrong with it.
"""

import importlib
import logging
from contextlib import suppress
from typing import Any

from station.lean import without

with without("asammdf"):
    import can
    from can.interfaces.virtual import VirtualBus

for _name in ("can", "asammdf"):
    logging.getLogger(_name).addHandler(logging.NullHandler())

__all__ = ["VirtualBus", "can", "mf4"]


def mf4() -> Any:
    """python-can's module for MF4 files, with asammdf: it is loaded anew where it was loaded without."""
    module = importlib.import_module("can.io.mf4")
    if module.asammdf is None:
        module = importlib.reload(module)
    _hush()
    return module


def _hush() -> None:
    """asammdf brings a handler that writes to standard error, and complains there of files that it could not open."""
    from asammdf.blocks.mdf_v4 import MDF4

    logging.getLogger("asammdf").handlers[:] = [logging.NullHandler()]
    if MDF4.__del__ is not _leave:
        MDF4.__del__ = _leave  # type: ignore[method-assign]


def _leave(recording: Any) -> None:
    """Closes what a recording had opened; one that was refused half-way lacks what its close() takes away last."""
    with suppress(AttributeError):
        recording.close()
