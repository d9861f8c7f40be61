"""The time line's unchanging part, for a page to fetch once a run: cells with their pictures, each drawn once."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

from station.reporting.drawing import fixture

#: An axis of the device counts as up when it lies so near the vertical.
_UPRIGHT = 0.985


def plan_id(cells: Sequence[Mapping[str, Any]]) -> str:
    """What names a plan: the same cells, the same name."""
    return hashlib.sha256(json.dumps(cells, sort_keys=True).encode()).hexdigest()[:12]


def plan_document(cells: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """`id`, `pictures` (SVG) and `cells`: kind, name, run, true, `up` (+x where that axis is up), and the numbers of
    their pictures as `picture` and `before`."""
    pictures: dict[str, int] = {}

    def number(pose: Any, name: str, towards: Any = None) -> int:
        return pictures.setdefault(fixture.picture(pose, name, towards), len(pictures))

    shown = [
        {
            **{key: cell.get(key) for key in ("kind", "name", "run", "true")},
            "up": _up(cell.get("pose")),
            "picture": number(cell.get("pose"), cell["name"]) if cell["kind"] in ("stop", "turn", "verify") else None,
            "before": number(cell["before"], cell["name"], cell.get("pose")) if cell.get("before") else None,
        }
        for cell in cells
    ]
    return {"id": plan_id(cells), "pictures": list(pictures), "cells": shown}


def _up(pose: Sequence[Sequence[float]] | None) -> str:
    """The device's axis that points up, such as +x; '' where none does."""
    if pose is None:
        return ""
    row = pose[2]
    axis = max(range(3), key=lambda i: abs(row[i]))
    return f"{'+' if row[axis] > 0 else '−'}{'xyz'[axis]}" if abs(row[axis]) > _UPRIGHT else ""
