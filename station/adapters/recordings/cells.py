"""Cells of text that are numbers after all: among units and brackets, in hex, with thousands, times of day."""

import re
from itertools import pairwise

import numpy as np

from station.adapters.recordings import dialect, stamps
from station.domain.core.types import Array, Floats

#: A number with what stands before and behind it; what stands behind may be its unit.
_AMONG = re.compile(r"^([^\d+\-.]*)([-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?)\s*([^\d]*)$")
_UNIT = re.compile(r"^[a-zµμ°/²^]{1,8}\d?$", re.IGNORECASE)
#: Cells that change this seldom from row to row are labels.
SELDOM = 0.1
SAMPLE = 400


def numbers(cells: Array, decimal: str) -> tuple[Floats, str] | None:
    """Numbers (n) of cells of which a few are none, and their unit where the cells state one; None where it is text."""
    sample = [str(c).strip() for c in cells[:SAMPLE] if str(c).strip()]
    if stamps.are_stamps(sample[:200]):
        return stamps.seconds(cells), "s"
    if sum(map(dialect.is_number, sample)) > 0.5 * max(len(sample), 1):
        return np.array([dialect.cell_value(str(c), decimal) for c in cells], float), ""
    return _among(cells, sample, decimal)


def _among(cells: Array, sample: list[str], decimal: str) -> tuple[Floats, str] | None:
    """Numbers between one text before and one behind, which are no labels."""
    found = [m for c in sample if (m := _AMONG.match(c))]
    around = {(m[1].strip(), m[3].strip()) for m in found}
    changes = sum(a != b for a, b in pairwise(sample))
    if len(found) < 0.9 * max(len(sample), 1) or len(around) != 1 or changes <= SELDOM * len(sample):
        return None
    ((_, behind),) = around
    values = [m[2] if (m := _AMONG.match(str(c).strip())) else "" for c in cells]
    unit = behind if _UNIT.match(behind) else ""
    return np.array([dialect.cell_value(v, decimal) for v in values], float), unit
