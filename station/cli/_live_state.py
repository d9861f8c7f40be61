"""What a run tells the page: its state as one small file beside the log, replaced whole at every event."""

import json
import os
import secrets
import time
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from station.cli import _output
from station.domain.recipe.recipe import Recipe
from station.domain.run.progress import Event, LiveReading
from station.domain.run.run_state import RunState
from station.messages import Message
from station.ports.bus import Bus
from station.service.itinerary import tumble_visits, verification_visits
from station.service.stop_request import StopRequest

SCHEMA = "station.live/1"
#: A paced run looks this often whether it was stopped, s.
_POLL_S = 0.02
#: Readings within a dwell come to the page no more often, s: each write costs a rename on the disk.
_READING_INTERVAL_S = 0.2


class LiveStateWriter:
    """Folds events into a RunState and writes `<log>.live.json` (tmp and rename).

    The log is the record and this only a view of it: a view that cannot be written is said once and stops nothing.
    """

    def __init__(self, database: Path, recipe: Recipe, told: Mapping[str, Any], bus: Bus | None = None) -> None:
        self._path = database.with_name(database.name + ".live.json")
        stops = [
            *(s for run in range(len(recipe.runs)) for s in tumble_visits(recipe, run)),
            *verification_visits(recipe),
        ]
        self._failed = False
        self._bus = bus
        self._written_s = 0.0
        self._state = RunState(stops=tuple(s.position for s in stops))
        self._head = {
            "schema": SCHEMA,
            "pid": os.getpid(),
            "recipe": f"{recipe.name}/{recipe.version}",
            "unit": recipe.unit,
            "poses": [(s.nest @ s.seat).tolist() for s in stops],
            **told,
        }

    def event(self, event: Event) -> None:
        """Takes one event in and shows the state after it."""
        self._state = self._state.after(event, time.time())
        if not isinstance(event, LiveReading) or time.monotonic() - self._written_s > _READING_INTERVAL_S:
            self._write()

    def ask(self, action: Message) -> str:
        """Shows what a person must do and confirm; the mark that the answer must bear."""
        mark = secrets.token_hex(8)
        self._state = replace(self._state, confirm=action, question=mark)
        self._write()
        return mark

    def clear_question(self, waited_s: float) -> None:
        """Nothing is asked any more; the time that it took is no part of the estimate."""
        self._state = replace(self._state, confirm=None, question="", began_s=self._state.began_s + waited_s)
        self._write()

    def _write(self) -> None:
        self._written_s = time.monotonic()
        try:
            write_atomically(
                self._path, {**self._head, "at_s": time.time(), "bus": self._bus_status(), "state": self._state}
            )
        except OSError as exc:
            if not self._failed:
                _output.print_remark(
                    f"{self._path} cannot be written ({exc.strerror}); the page does not follow this run"
                )
            self._failed = True

    def _bus_status(self) -> dict[str, Any] | None:
        """State and error counters of the bus right now."""
        if self._bus is None:
            return None
        return {"name": self._bus.name, "state": self._bus.state(), "counters": self._bus.counters()}


def write_atomically(path: Path, document: Mapping[str, Any]) -> None:
    """The document in one piece or not at all; a page must never read half of it. Errors: OSError."""
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    beside.write_text(json.dumps(document, allow_nan=False, default=_field_values), encoding="utf-8")
    beside.replace(path)


def _field_values(value: Any) -> dict[str, Any]:
    """A message as documents hold it, any other frozen value by its fields; asdict would copy every number in it."""
    if isinstance(value, Message):
        return value.document()
    return {f.name: getattr(value, f.name) for f in fields(value)}


class RealTimePacer:
    """Holds a run on virtual time back to `factor` times real time, so that a person can watch and stop it."""

    def __init__(self, factor: float | None, virtual_s: Callable[[], float], stop: StopRequest) -> None:
        self._factor, self._virtual_s, self._stop = factor, virtual_s, stop
        self._began = (virtual_s(), time.monotonic())

    def skip(self, waited_s: float) -> None:
        """Real time that passed while virtual time stood still, because a person did something, is not made up for."""
        self._began = (self._began[0], self._began[1] + waited_s)

    def keep(self) -> None:
        """Waits until real time has caught up; a stop ends the wait."""
        if self._factor is None:
            return
        until_s = self._began[1] + (self._virtual_s() - self._began[0]) / self._factor
        while not self._stop.requested and (left_s := until_s - time.monotonic()) > 0:
            time.sleep(min(_POLL_S, left_s))
