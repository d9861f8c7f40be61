"""The line in figures: what finished attempts come to, one by one and counted."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import pairwise
from typing import Any

from station.domain.cell.effectiveness import Effectiveness
from station.domain.methods import coefficients
from station.domain.recipe.blocks import Limits
from station.domain.recipe.recipe import Recipe
from station.domain.records import stored_attempt
from station.ports.log_reader import YIELD_CELL, YIELD_SEPARATOR, Yield

#: What the yields are split by.
YIELD_SPLITS = YIELD_CELL
#: Parts of a cycle, in their order.
CYCLE_PARTS = ("identify", "measure", "compute and write", "verify", "close")
#: Values that a control chart can follow.
VALUE_NAMES = (*coefficients.NAMES, "residual rms", "noise", "cycle time")


@dataclass(frozen=True, slots=True)
class AttemptValues:
    """One finished attempt: its values by name, its parts of the cycle (s), and the tilt of each position (degrees)."""

    serial: str
    nest: str
    started_ns: int
    outcome: str
    values: Mapping[str, float]
    parts: Mapping[str, float]
    tilts: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class LineStatistics:
    """Everything that the charts show. attempts: oldest first; reasons: check → how often; recipe: the newest's;
    shifts: those of a line, oldest first; simulated: attempts whose rig and devices were."""

    recipe: Recipe | None
    attempts: tuple[AttemptValues, ...]
    yields: Mapping[str, Sequence[Yield]]
    reasons: Mapping[str, int] = field(default_factory=dict)
    shifts: Sequence[Effectiveness] = ()
    simulated: int = 0


def values_and_checks(stored: dict[str, Any]) -> tuple[AttemptValues, tuple[str, ...]]:
    """One finished attempt's values, and the checks that speak against it."""
    return values_of(stored), tuple(_checks(stored))


def limits_of(name: str, limits: Limits) -> tuple[float | None, float | None]:
    """Lower and upper acceptance limit of a value in the recipe; None: it has none."""
    if name == "residual rms":
        return None, limits.residual
    if name == "noise":
        return None, limits.noise
    kind = name.partition(" ")[0]
    half = {"offset": limits.offset, "gain": limits.gain, "cross-axis": limits.cross_axis}.get(kind)
    nominal = 1.0 if kind == "gain" else 0.0
    return (None, None) if half is None else (nominal - half, nominal + half)


def yields_by_split(cells: Sequence[Yield]) -> dict[str, list[Yield]]:
    """Yields by each split: a unit is first or last wherever it is counted, so the cells' counts only add up."""
    found: dict[str, list[Yield]] = {}
    for place, by in enumerate(YIELD_SPLITS):
        groups: dict[str, list[Yield]] = {}
        for cell in cells:
            groups.setdefault(cell.group.split(YIELD_SEPARATOR)[place], []).append(cell)
        found[by] = [_sum(name, group) for name, group in sorted(groups.items())]
    return found


def _sum(name: str, cells: Sequence[Yield]) -> Yield:
    counts = {f.name: sum(getattr(c, f.name) for c in cells) for f in fields(Yield)[1:-1]}
    lasted_s = sum(c.attempts * c.mean_duration_s for c in cells)
    return Yield(group=name, **counts, mean_duration_s=lasted_s / counts["attempts"])


def _checks(stored: dict[str, Any]) -> list[str]:
    verdict = stored_attempt.result(stored, "verdict") or {}
    return sorted({str(r["check"]) for r in verdict.get("reasons", ())})


def values_of(stored: dict[str, Any]) -> AttemptValues:
    """One finished attempt's values; stored: everything the log holds of it."""
    fit, verdict = stored_attempt.result(stored, "calibration") or {}, stored_attempt.result(stored, "verdict") or {}
    values: dict[str, float] = {}
    if fit.get("offset") is not None:
        theta = [*fit["offset"], *(v for row in fit["matrix"] for v in row)]
        values |= dict(zip(coefficients.NAMES, theta, strict=True)) | {"residual rms": fit["residual_rms"]}
    if verdict.get("noise") is not None:
        values["noise"] = verdict["noise"]
    values["cycle time"] = (stored["ended_ns"] - stored["started_ns"]) / 1e9
    tilts = {p["name"]: p["tilt_deg"] for p in fit.get("positions") or () if p["tilt_deg"] is not None}
    known = {k: float(v) for k, v in values.items() if math.isfinite(v)}
    return AttemptValues(
        serial=stored["serial"],
        nest=f"{stored['station']}/{stored['nest']}",
        started_ns=stored["started_ns"],
        outcome=str(stored["outcome"]),
        values=known,
        parts=_parts(stored),
        tilts=tilts,
    )


def _parts(stored: dict[str, Any]) -> dict[str, float]:
    """How long each part lasted, s: from the record's own time stamps; parts that did not happen take none."""
    tumble = [v for v in stored["visits"] if v["kind"] != "verify"]
    verify = [v for v in stored["visits"] if v["kind"] == "verify"]
    marks = [stored["started_ns"]]
    marks.append(tumble[0]["arrived_ns"] if tumble else marks[-1])
    marks.append(tumble[-1]["left_ns"] if tumble else marks[-1])
    marks.append(verify[0]["arrived_ns"] if verify else marks[-1])
    marks.append(verify[-1]["left_ns"] if verify else marks[-1])
    marks.append(stored["ended_ns"])
    return {name: (b - a) / 1e9 for name, (a, b) in zip(CYCLE_PARTS, pairwise(marks), strict=True)}
