"""The five states of the operator's screen, set up by the files that a run and the page share: no run is needed."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from station.domain.recipe.recipe import Recipe
from station.panel_protocol import timeline
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.live_state import recipe_label
from station.panel_protocol.queue import LoadQueue, WaitingUnit

#: Full HD, a small desk screen, a phone; CSS pixels.
SIZES = ((1920, 1080), (1280, 800), (390, 844))
STATES = ("scan", "ready", "running", "act", "done")
SERIALS = {"A": "SN04417", "B": "SN04418", "C": "SN04419", "D": "SN04420"}
NEXT = {"A": "SN04421", "B": "SN04422"}
#: Of the loads after the next.
LATER = tuple(f"SN044{number}" for number in range(25, 33))
_BIAS = {"A": 0.012, "B": -0.004, "C": 0.006, "D": -0.009}
#: The run of these pictures: this process, which holds the log's lock meanwhile.
_BEGAN_S = 1_795_000_000.0


@dataclass
class Scene:
    """One log's files. pid: of the process that is taken for the run."""

    database: Path
    recipe: Recipe
    pid: int

    def show(self, state: str, later: tuple[str, ...] = ()) -> None:
        """Puts the files into that state. later: serials behind the next load."""
        queue = LoadQueue(companion_file(self.database, Companion.QUEUE))
        queue.clear()
        live = companion_file(self.database, Companion.LIVE)
        live.unlink(missing_ok=True)
        if state == "scan":
            queue.put({"A": WaitingUnit(SERIALS["A"])})
        elif state == "ready":
            queue.put({nest: WaitingUnit(serial) for nest, serial in SERIALS.items()})
        else:
            queue.put({nest: WaitingUnit(serial) for nest, serial in NEXT.items()})
            live.write_text(json.dumps(self.live(state)))
        for serial in later:
            queue.append(serial)

    @contextmanager
    def running(self) -> Iterator[None]:
        """While it lasts, this process is the run on the log."""
        lock = companion_file(self.database, Companion.OWNER)
        with lock.open("w") as handle:
            handle.write(json.dumps({"pid": self.pid}))
            handle.flush()
            yield
        lock.unlink()

    def live(self, state: str) -> dict[str, Any]:
        """The live file of a run in that state."""
        cells = timeline.cells_of(self.recipe)
        kinds = [c.kind for c in cells]
        at = {"running": kinds.index("stop") + 2, "act": kinds.index("turn"), "done": len(cells)}[state]
        stops = [i for i, kind in enumerate(kinds) if kind == "stop"]
        true = cells[min(at, len(cells) - 1)].true or (0.0, 0.0, 1.0)
        nests = [self._nest(nest, state, true) for nest in SERIALS]
        question = {"id": "turn-units", "number": 2, "angle_deg": 180.0, "axis": "z", "seating": "turned"}
        shown = {
            "phase": "done" if state == "done" else "measure",
            "position": cells[at].name if state == "running" else "",
            "confirm": question if state == "act" else None,
            "question": "0123456789abcdef" if state == "act" else "",
            "done": sum(i < at for i in stops),
            "total": len(stops) + 2,
            "began_s": _BEGAN_S,
            "over": state == "done",
            "fault": None,
            "nests": nests,
            "messages": [],
        }
        return {
            "schema": "station.live/1", "pid": self.pid, "recipe": recipe_label(self.recipe), "unit": "g",
            "product": "accelerometer", "cells": timeline.cell_documents(cells), "cell": at, "cell_since_s": 0.0,
            "warm_until_s": 0.0, "expected_s": [2.0 if c.kind == "identify" else 3.0 for c in cells],
            "bus": {"name": "can0", "state": "active", "counters": {"sending": 0, "receiving": 0}}, "state": shown,
        }  # fmt: skip

    def _nest(self, nest: str, state: str, true: tuple[float, ...]) -> dict[str, Any]:
        bias = _BIAS[nest]
        there: dict[str, Any] = {
            "serial": SERIALS[nest], "nest": nest, "node": 17, "attempt": "a", "device": "accelerometer 1.0.0",
            "vector": [v + bias * (i + 1) / 2 for i, v in enumerate(true)], "outcome": "", "reasons": [],
            "step": "measure", "since_s": 0.0, "took_s": [1.2], "figure": None,
        }  # fmt: skip
        if state != "done":
            return there
        ended = {"step": "", "took_s": [1.2, 26.0, 4.1, 6.0]}
        if nest == "B":
            shown = {"coefficient": "gain y", "deviation": -0.0524, "limit": 0.05, "unit": ""}
            why = {"id": "coefficient-beyond-limit", **shown}
            figure = {"what": "gain y", "value": 0.9476, "low": 0.95, "high": 1.05, "target": 1.0, "unit": "1"}
            return {**there, **ended, "outcome": "FAIL", "reasons": [why], "figure": figure, "took_s": [1.4, 26.0]}
        limits = {"low": 0.0, "high": 0.005, "target": 0.0, "unit": "g"}
        error = {"what": "output error", "value": 0.0009 + abs(bias) / 50, **limits}
        return {**there, **ended, "outcome": "PASS", "figure": error}
