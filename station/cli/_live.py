"""What a run tells the page: its state as one small file beside the log, replaced whole at every event."""

import json
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from station.cli import _face
from station.domain.progress import Event
from station.domain.recipe import Recipe
from station.domain.run_state import RunState
from station.service.itinerary import tumble, verification
from station.service.stop import Stop

SCHEMA = "station.live/1"
#: A paced run looks this often whether it was stopped, s.
_LOOK_S = 0.02


class Live:
    """Folds events into a RunState and writes `<log>.live.json` (tmp and rename).

    The log is the record and this only a view of it: a view that cannot be written is said once and stops nothing.
    """

    def __init__(self, database: Path, recipe: Recipe, told: Mapping[str, Any]) -> None:
        self._path = database.with_name(database.name + ".live.json")
        stops = [*(s for run in range(len(recipe.runs)) for s in tumble(recipe, run)), *verification(recipe)]
        self._failed = False
        self._state = RunState(stops=tuple(s.position for s in stops))
        self._head = {
            "schema": SCHEMA,
            "pid": os.getpid(),
            "recipe": f"{recipe.name}/{recipe.version}",
            "unit": recipe.unit,
            "poses": {s.position: (s.nest @ s.seat).tolist() for s in stops},
            **told,
        }

    def event(self, event: Event) -> None:
        """Takes one event in and shows the state after it."""
        now_s = time.time()
        self._state = self._state.after(event, now_s)
        try:
            write(self._path, {**self._head, "at_s": now_s, "state": asdict(self._state)})
        except OSError as exc:
            if not self._failed:
                _face.remark(f"{self._path} cannot be written ({exc.strerror}); the page does not follow this run")
            self._failed = True


def write(path: Path, document: Mapping[str, Any]) -> None:
    """The document in one piece or not at all; a page must never read half of it. Errors: OSError."""
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    beside.write_text(json.dumps(document, allow_nan=False), encoding="utf-8")
    beside.replace(path)


class Pace:
    """Holds a run on virtual time back to `factor` times real time, so that a person can watch and stop it."""

    def __init__(self, factor: float | None, virtual_s: Callable[[], float], stop: Stop) -> None:
        self._factor, self._virtual_s, self._stop = factor, virtual_s, stop
        self._began = (virtual_s(), time.monotonic())

    def keep(self) -> None:
        """Waits until real time has caught up; a stop ends the wait."""
        if self._factor is None:
            return
        until_s = self._began[1] + (self._virtual_s() - self._began[0]) / self._factor
        while not self._stop.requested and (left_s := until_s - time.monotonic()) > 0:
            time.sleep(min(_LOOK_S, left_s))
