"""Which part of a CAN log is which stop of which unit: schema station.marks/1."""

from collections.abc import Iterable, Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from station.domain.can.sensor_layout import SensorLayout
from station.domain.capture.visit import CapturedVisit
from station.domain.core.types import Frames, NestAssignment
from station.domain.recipe.fields import Finite, Name, StrictModel

#: A frame beside the dwell is this far away where the log holds none, s.
ASSUMED_GAP_S = 0.001


class Annotation(StrictModel):
    """One dwell. start_s (with) and end_s (without) count from the log's first frame; node: of the unit's device;
    attempt: which one, where the marks hold several of one unit; simulated: SIMULATED where rig and device were;
    recipe: the name of its own."""

    unit: Name
    node: Annotated[int, Field(ge=1, le=127)]
    run: Annotated[int, Field(ge=0)]
    visit: Annotated[int, Field(ge=0)]
    position: Name
    start_s: Finite
    end_s: Finite
    seating: Name = "home"
    attempt: str = ""
    simulated: str = ""
    recipe: str = ""


class Annotations(StrictModel):
    """All dwells of a log. recipe: its name, where a run made them and the marks do not each name their own."""

    schema_: Annotated[Literal["station.marks/1"], Field(alias="schema")] = "station.marks/1"
    recipe: str | None = None
    marks: tuple[Annotation, ...] = ()

    def recipes(self) -> tuple[str, ...]:
        """The recipes that the marks name, in their order."""
        named = (mark.recipe or self.recipe for mark in self.marks)
        return tuple(dict.fromkeys(name for name in (*named, self.recipe) if name))

    def of_recipe(self, name: str) -> "Annotations":
        """Those of one of several recipes; all, where they name one or none."""
        if name not in self.recipes():
            return self
        return self.model_copy(update={"marks": tuple(m for m in self.marks if m.recipe in ("", name))})

    def units(self) -> dict[str, list[Annotation]]:
        """Marks by unit, and by attempt where there are several, in the order of run and visit."""
        found: dict[str, list[Annotation]] = {}
        for mark in sorted(self.marks, key=lambda m: (m.unit, m.attempt, m.run, m.visit)):
            found.setdefault(f"{mark.unit} {mark.attempt}".strip(), []).append(mark)
        return found


def captured_visits(marks: Sequence[Annotation], frames: Frames) -> list[CapturedVisit]:
    """The visits of one unit, cut out of a whole log."""
    zero = int(frames.time_ns[0])
    found = []
    for mark in marks:
        begin, end = zero + round(mark.start_s * 1e9), zero + round(mark.end_s * 1e9)
        inside = slice(*np.searchsorted(frames.time_ns, [begin, end]).tolist())
        found.append(
            CapturedVisit(mark.run, mark.visit, mark.position, mark.seating, begin, begin, end, frames[inside])
        )
    return found


def annotate_visits(
    seat: NestAssignment, visits: Iterable[CapturedVisit], layout: SensorLayout, zero_ns: int
) -> list[Annotation]:
    """Marks of a unit's visits in a log whose first frame came at `zero_ns`.

    They are set half-way to the neighbouring frames, so that formats that keep microseconds move no frame across.
    """
    can_id = layout.id_of(layout.sample, seat.node)
    found = []
    for v in visits:
        time_ns = v.frames.time_ns[v.frames.can_id == can_id]
        start, end = _between(time_ns, v.from_ns) - zero_ns, _between(time_ns, v.to_ns) - zero_ns
        found.append(
            Annotation(
                unit=seat.serial,
                node=seat.node,
                run=v.run,
                visit=v.visit,
                position=v.position,
                start_s=start / 1e9,
                end_s=end / 1e9,
                seating=v.seating,
            )
        )
    return found


def _between(time_ns: "np.ndarray[tuple[int], np.dtype[np.int64]]", bound_ns: int) -> int:
    """The middle between the last frame before a bound and the first from it on."""
    at = int(np.searchsorted(time_ns, bound_ns))
    margin_ns = round(ASSUMED_GAP_S * 1e9)
    before = int(time_ns[at - 1]) if at > 0 else (int(time_ns[0]) - margin_ns if len(time_ns) else bound_ns)
    after = int(time_ns[at]) if at < len(time_ns) else (int(time_ns[-1]) + margin_ns if len(time_ns) else bound_ns)
    return (before + after) // 2
