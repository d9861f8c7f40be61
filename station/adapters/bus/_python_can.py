"""python-can without asammdf, and with it pandas, until an MF4 recording is opened.

What it logs goes nowhere: whoever reads a recording is told in one sentence what is wrong with it.
"""

import importlib
import logging
from typing import Any

from station.optional_imports import hide_packages

with hide_packages("asammdf"):
    import can
    from can.interfaces.virtual import VirtualBus

logging.getLogger("can").addHandler(logging.NullHandler())

__all__ = ["VirtualBus", "can", "mf4"]


def mf4() -> Any:
    """python-can's module for MF4 files, with asammdf: it is loaded anew where it was loaded without."""
    module = importlib.import_module("can.io.mf4")
    with hide_packages("polars"):  # asammdf's, for tables that nobody asks for here
        return importlib.reload(module) if module.asammdf is None else module
