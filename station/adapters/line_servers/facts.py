"""What both servers say, from the line's own word. A line that no longer says anything is not available."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from station.domain.cell.adjustment import UnitMode
from station.domain.cell.packml import State
from station.messages import Message, render

#: OPC 40001-1, MachineryItemState.
NOT_AVAILABLE, OUT_OF_SERVICE, NOT_EXECUTING, EXECUTING = 0, 1, 2, 3
#: How an outcome travels as a number.
OUTCOME_CODES = {"": 0, "PASS": 1, "FAIL": 2, "ERROR": 3, "ABORTED": 4, "INTERRUPTED": 5}


@dataclass(frozen=True, slots=True)
class StopFact:
    """Why the line stood. id: of the message; text: its sentence; state: in which it began; seconds since 1970, ended_s
    None while it lasts."""

    id: str
    text: str
    state: int
    began_s: float
    ended_s: float | None


@dataclass(frozen=True, slots=True)
class LineFacts:
    """state: None where no line runs; nests: name, serial and outcome of each; seconds: of each state by name; times_s:
    those that can be adjusted; units: handed back since the start and in all, by bin; ideal_s: time of a unit at best,
    0 where nobody says; stops: the newest first."""

    state: State | None
    station: str
    recipe: str
    load: int
    loads: int
    why: str
    nests: tuple[tuple[str, str, str], ...]
    seconds: Mapping[str, float]
    mode: int = UnitMode.PRODUCE
    times_s: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    units_per_hour: float = 0.0
    ideal_s: float = 0.0
    stops: tuple[StopFact, ...] = ()

    @property
    def speed(self) -> float:
        """Units an hour at present: none where it does not produce."""
        return self.units_per_hour if self.item_state == EXECUTING else 0.0

    @property
    def item_state(self) -> int:
        """MachineryItemState (OPC 40001-1)."""
        if self.state is None:
            return NOT_AVAILABLE
        if self.state in (State.ABORTING, State.ABORTED, State.CLEARING, State.STOPPED, State.STOPPING):
            return OUT_OF_SERVICE
        return EXECUTING if self.state in (State.STARTING, State.EXECUTE, State.COMPLETING) else NOT_EXECUTING


def facts_of(document: Mapping[str, Any] | None, why: str, *, alive: bool) -> LineFacts:
    """From the document of `station.line/1`; None: there is none. why: its sentence; alive: its process is there."""
    if document is None:
        return LineFacts(None, "", "", 0, 0, "", (), {})
    return LineFacts(
        state=State(document["state"]) if alive else None,
        station=str(document["station"]),
        recipe=str(document["recipe"]),
        load=int(document["load"]),
        loads=int(document["loads"]),
        why=why,
        nests=tuple((str(n["nest"]), str(n["serial"]), str(n["outcome"])) for n in document["nests"]),
        seconds={str(name): float(seconds) for name, seconds in document["seconds"].items()},
        mode=int(document.get("mode", UnitMode.PRODUCE)),
        times_s={str(name): float(seconds) for name, seconds in document.get("times_s", {}).items()},
        units={str(name): (int(counts[0]), int(counts[1])) for name, counts in document.get("units", {}).items()},
        units_per_hour=float(document.get("units_per_hour", 0.0)),
        ideal_s=float(document.get("ideal_s", 0.0)),
        stops=tuple(_stop(stop) for stop in document.get("stop_reasons", ())),
    )


def _stop(document: Mapping[str, Any]) -> StopFact:
    why = Message.of(document["why"])
    ended_s = document["ended_s"]
    return StopFact(
        why.id,
        render(why),
        int(document["state"]),
        float(document["began_s"]),
        None if ended_s is None else float(ended_s),
    )
