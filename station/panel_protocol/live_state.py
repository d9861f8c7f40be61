"""What a run tells the page: its state as one small file beside the log, replaced whole at every event."""

import json
import os
import secrets
import time
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from station.domain.recipe.recipe import Recipe
from station.domain.run.progress import Event, LiveReading
from station.domain.run.run_state import RunState
from station.files.json_text import NOT_AS_EXPECTED, read_json
from station.files.replace import replace_text
from station.messages import Message
from station.panel_protocol import timeline
from station.panel_protocol.companion import Companion, companion_file
from station.ports.bus import Bus
from station.service.itinerary import tumble_visits, verification_visits

SCHEMA = "station.live/1"
#: Readings within a dwell come to the page no more often, s: each write costs a rename on the disk.
_READING_INTERVAL_S = 0.2


class LiveStateWriter:
    """Folds events into a RunState and writes the file of Companion.LIVE.

    The log is the record and this only a view of it: where it cannot be written, `warn` gets one sentence and
    nothing stops.
    """

    def __init__(
        self,
        database: Path,
        recipe: Recipe,
        head: Mapping[str, Any],
        warn: Callable[[str], None],
        bus: Bus | None = None,
    ) -> None:
        self._path = companion_file(database, Companion.LIVE)
        planned = [
            *(v for run in range(len(recipe.runs)) for v in tumble_visits(recipe, run)),
            *verification_visits(recipe),
        ]
        self._failed = False
        self._warn = warn
        self._bus = bus
        self._written_s = 0.0
        self._state = RunState(visits=tuple(v.position for v in planned))
        cells = timeline.cells_of(recipe)
        self._line = timeline.Timeline(timeline.learned(cells, expected_s(database, recipe)))
        self._head = {
            "schema": SCHEMA,
            "pid": os.getpid(),
            "recipe": recipe_label(recipe),
            "unit": recipe.unit,
            "product": recipe.product,
            "cells": timeline.cell_documents(cells),
            **head,
        }

    def event(self, event: Event) -> None:
        """Takes one event in and shows the state after it."""
        now_s = time.time()
        self._state = self._state.after(event, now_s)
        self._line = self._line.after(event, now_s)
        if not isinstance(event, LiveReading) or time.monotonic() - self._written_s > _READING_INTERVAL_S:
            self._write()

    def ask(self, action: Message) -> str:
        """Shows what a person must do and confirm; the mark that the answer must bear."""
        mark = secrets.token_hex(8)
        self._state = replace(self._state, confirm=action, question=mark)
        self._line = self._line.waiting_for(action, time.time())
        self._write()
        return mark

    def clear_question(self, waited_s: float) -> None:
        """Nothing is asked any more; the time that it took is no part of the estimate."""
        self._state = replace(self._state, confirm=None, question="", began_s=self._state.began_s + waited_s)
        self._write()

    def _write(self) -> None:
        self._written_s = time.monotonic()
        try:
            moment = {"at_s": time.time(), "bus": self._bus_status(), **self._line.document()}
            document = {**self._head, **moment, "state": self._state}
            replace_text(self._path, json.dumps(document, allow_nan=False, default=_field_values))
        except OSError as exc:
            if not self._failed:
                self._warn(f"{self._path} cannot be written ({exc.strerror}); the page does not follow this run")
            self._failed = True

    def _bus_status(self) -> dict[str, Any] | None:
        """State and error counters of the bus right now."""
        if self._bus is None:
            return None
        return {"name": self._bus.name, "state": self._bus.state(), "counters": self._bus.counters()}


def read_live_state(path: Path) -> dict[str, Any]:
    """The live file's document. Errors: OSError; NOT_AS_EXPECTED where it has not the shape of LiveStateWriter, as far
    as a page stands on it."""
    document: dict[str, Any] = dict(read_json(path))
    state = document.setdefault("state", {})
    nests = state.get("nests", [])
    _require(dict, state, document.get("bus") or {}, *nests, *document.get("cells", []))
    _require(list, nests, state.get("messages", []), document.get("expected_s", []), document.get("cells", []))
    _require(str, state.get("question", ""), state.get("phase", ""), *(n.get("attempt", "") for n in nests))
    _require(str, *(nest[key] for nest in nests for key in ("serial", "nest", "outcome")))
    numbers = [state.get("began_s", 0), *(v for nest in nests for v in nest.get("vector") or ())]
    _require((int, float), *numbers)
    list(map(float, numbers))  # an integer may have more digits than a number of the page
    return document


def _require(kind: type | tuple[type, ...], *values: object) -> None:
    """Errors: TypeError where one is of another kind."""
    if not all(isinstance(value, kind) for value in values):
        raise TypeError


def recipe_label(recipe: Recipe) -> str:
    """Name and version, as the live file names a recipe."""
    return f"{recipe.name}/{recipe.version}"


def expected_s(database: Path, recipe: Recipe) -> list[float]:
    """How long each cell of the time line is expected to take, s, after the last load of this recipe on this log;
    empty where the file beside the log knows none."""
    try:
        document = read_json(companion_file(database, Companion.LIVE))
        return [float(s) for s in document["expected_s"]] if document["recipe"] == recipe_label(recipe) else []
    except (OSError, *NOT_AS_EXPECTED):
        return []


def _field_values(value: Any) -> dict[str, Any]:
    """A message as documents hold it, any other frozen value by its fields; asdict would copy every number in it."""
    if isinstance(value, Message):
        return value.document()
    return {f.name: getattr(value, f.name) for f in fields(value)}
