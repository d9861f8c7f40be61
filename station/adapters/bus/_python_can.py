"""python-can without asammdf, and with it pandas, until an MF4 recording is opened."""

import importlib
from typing import Any

from station.lean import without

with without("asammdf"):
    import can
    from can.interfaces.virtual import VirtualBus

__all__ = ["VirtualBus", "can", "mf4_reader"]


def mf4_reader() -> Any:
    """python-can's reader of MF4 files, with asammdf: its module is loaded anew where it was loaded without."""
    mf4 = importlib.import_module("can.io.mf4")
    if mf4.asammdf is None:
        mf4 = importlib.reload(mf4)
    return mf4.MF4Reader
