"""What a cause's residual is drawn against: the quantity that the cause itself depends on, as its file says."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats, Labels
from station.model.effect import DrawnOver
from station.reporting.diagnosis.data import CauseSignature, ReportData
from station.reporting.diagnosis.quantity_format import unit_words
from station.reporting.diagnosis.sentences import report_text

#: Covariates of visits by the way a cause is drawn, and the message of the axis.
_COVARIATES: dict[str, tuple[str, str]] = {
    "time": ("time_s", "axis-time"),
    "temperature": ("temperature_degC", "axis-temperature"),
    "temperature-rate": ("temperature_rate", "axis-temperature-rate"),
    "since-power": ("since_power_s", "axis-since-power"),
    "since-clamp": ("since_clamp_s", "axis-since-clamp"),
    "motor": ("motor", "axis-motor"),
}
#: Stimuli (recipe's unit) that differ by less at one position are those of one seating.
SAME_SEATING_MAX = 0.2
#: A course along an axis is a polynomial of this degree, of fewer where a bend would have fewer points than these.
BEND_DEGREE, POINTS_A_BEND = 5, 4
#: Pairs of axes.
PAIRS = ((0, 1), (0, 2), (1, 2))
#: Levels whose groups belong to one unit: one unit is drawn.
_OF_ONE_UNIT = ("unit", "run", "power-on", "visit")


@dataclass(frozen=True, slots=True, eq=False)
class CauseAxis:
    """Where each visit stands (v), NaN for nowhere; what the axis is; words for the places 0, 1, 2 …"""

    at: Floats
    label: str
    places: tuple[str, ...] = ()

    @property
    def varies(self) -> bool:
        """Whether there is anything to see along it."""
        there = self.at[np.isfinite(self.at)]
        return len(there) > 1 and float(np.ptp(there)) > 0


@dataclass(frozen=True, slots=True, eq=False)
class AffectedVisits:
    """The visits (v) that show a cause best, and whose they are, empty for all of them."""

    rows: NDArray[np.bool_]
    whose: str = ""


def affected_visits(
    data: ReportData, cause: Mapping[str, Any], signature: Floats, over: DrawnOver | None
) -> AffectedVisits:
    """Those of the group that the cause hits hardest, where groups differ."""
    kinds = {str(row["of"]).split(":", 1)[0] for row in cause["parameters"]}
    square = np.nansum(signature**2, axis=1)
    rows, whose = np.ones(len(square), bool), ""
    for kind in sorted(kinds & set(data.groups)):
        if over != "group" and len(data.groups[kind].names) > 1:
            i = _strongest(data.groups[kind], square)
            rows, whose = data.groups[kind].code == i, f"{kind} {data.groups[kind].names[i]}"
    if kinds & set(_OF_ONE_UNIT) and len(data.unit.names) > 1:
        i = _strongest(data.unit, square)
        rows, whose = data.unit.code == i, report_text("report-unit", name=data.unit.names[i])
    if (kinds & {"run", "visit"} and over != "run") or (over == "position" and _seated_twice(data, rows)):
        runs = np.unique(data.run[rows])
        if len(runs) > 1:
            worst = max(runs, key=lambda r: float(square[rows & (data.run == r)].mean()))
            rows = rows & (data.run == worst)
            whose = ", ".join(filter(None, (whose, report_text("report-run", number=int(worst)))))
    return AffectedVisits(rows, whose)


def _axis_text(key: str, **values: str) -> str:
    return unit_words(report_text(key, **values))


def _seated_twice(data: ReportData, rows: NDArray[np.bool_]) -> bool:
    """Whether the sensor lies in a position in more than one way, so that a position alone says little."""
    return data.felt is not None and any(
        float(np.ptp(data.felt[rows & (data.position.code == p)], axis=0).max(initial=0.0)) > SAME_SEATING_MAX
        for p in np.unique(data.position.code[rows])
    )


def _strongest(labels: Labels, square: Floats) -> int:
    count = np.maximum(np.bincount(labels.code, minlength=len(labels.names)), 1)
    return int(np.argmax(np.bincount(labels.code, square, len(labels.names)) / count))


def cause_axis(
    data: ReportData, cause: Mapping[str, Any], over: DrawnOver, signature: CauseSignature, i: int
) -> CauseAxis | None:
    """The axis for what sensor axis i (0 … k−1) reads; None where these data do not have it or it never changes."""
    if over in _COVARIATES:
        name, label = _COVARIATES[over]
        found = CauseAxis(data.values[name], report_text(label)) if name in data.values else None
    elif over in ("position", "group", "run", "visits", "order"):
        found = _by_visit(data, cause, over)
    elif data.told is not None:
        found = _along_stimulus(data, data.told, over, signature.values[:, i])
    else:
        found = None if data.felt is None else _by_reading(data, data.felt, over, signature.values[:, i], i)
    return found if found is not None and found.varies else None


def _by_visit(data: ReportData, cause: Mapping[str, Any], over: DrawnOver) -> CauseAxis | None:
    if over == "position":
        return CauseAxis(data.position.code.astype(float), "", data.position.names)
    if over == "run":
        names = tuple(report_text("report-run", number=n) for n in range(int(data.run.max()) + 1))
        return CauseAxis(data.run.astype(float), "", names)
    if over == "group":
        kinds = [str(row["of"]).split(":", 1)[0] for row in cause["parameters"]]
        labels = next((data.groups[kind] for kind in kinds if kind in data.groups), None)
        return None if labels is None else CauseAxis(labels.code.astype(float), "", labels.names)
    return CauseAxis(data.visit.astype(float), _axis_text("axis-order"))


def _by_reading(data: ReportData, felt: Floats, over: DrawnOver, signature: Floats, i: int) -> CauseAxis | None:
    """Axes that differ between the axes of the sensor."""
    unit, axis = data.unit_of_readings, "xyz"[i]
    if over == "input":
        return CauseAxis(felt[:, i], _axis_text("axis-input", axis=axis, unit=unit))
    if over == "step":
        before = np.where(data.previous[:, None] >= 0, felt[data.previous] - felt, np.nan)
        return CauseAxis(before[:, i], _axis_text("axis-step", axis=axis, unit=unit))
    if over == "other-axis":
        j = _likest(signature, {j: felt[:, j] for j in range(3) if j != i})
        return CauseAxis(felt[:, j], _axis_text("axis-input", axis="xyz"[j], unit=unit))
    if over == "input-product":
        j = _likest(signature, {j: felt[:, i] * felt[:, j] for j in range(3) if j != i})
        return CauseAxis(felt[:, i] * felt[:, j], _axis_text("axis-product", axis=axis, other="xyz"[j], unit=unit))
    if over == "temperature-input" and "temperature_degC" in data.values:
        degC, weight = data.values["temperature_degC"], felt[:, i] ** 2
        # About the mean that a gain takes up, so that only its change with temperature is left.
        off = degC - float(degC @ weight) / max(float(weight.sum()), 1e-300)
        return CauseAxis(off * felt[:, i], _axis_text("axis-temperature-input", axis=axis, unit=unit))
    return None


def _along_stimulus(data: ReportData, told: Floats, over: DrawnOver, signature: Floats) -> CauseAxis | None:
    """Where only lengths are known: what moves one axis moves a length by as much as that axis feels of it. Of the
    three axes, or pairs of them, the one that the length follows most."""
    unit, strength = data.unit_of_readings, float(np.median(np.linalg.norm(told, axis=1)))
    # A direction is told no better than that; visits of one position stand together.
    told = np.round(told / strength, 2) * strength
    if over in ("other-axis", "input-product"):
        products = {place: told[:, j] * told[:, k] for place, (j, k) in enumerate(PAIRS)}
        best = _likest(signature, products)
        axis, other = ("xyz"[j] for j in PAIRS[best])
        return CauseAxis(products[best], _axis_text("axis-product", axis=axis, other=other, unit=unit))
    if over == "input":
        j = _bends_along(signature, told)
        return CauseAxis(told[:, j], _axis_text("axis-input", axis="xyz"[j], unit=unit))
    if over == "step":
        steps = np.where(data.previous[:, None] >= 0, told[data.previous] - told, np.nan) * told
        there = np.isfinite(steps[:, 0])
        j = _bends_along(signature[there], steps[there])
        return CauseAxis(steps[:, j], _axis_text("axis-step-along", axis="xyz"[j], unit=unit))
    if over == "temperature-input" and "temperature_degC" in data.values:
        degC, square = data.values["temperature_degC"], told**2
        off = (degC[:, None] - degC @ square / np.maximum(square.sum(axis=0), 1e-300)) * square
        j = _likest(signature, dict(enumerate(off.T)))
        return CauseAxis(off[:, j], _axis_text("axis-temperature-input-along", axis="xyz"[j], unit=unit))
    return None


def _bends_along(signature: Floats, choices: Floats) -> int:
    """Of columns (v, 3) the one that a signature (v) is a smooth course of, as nearly as any is."""
    left = [float(np.var(signature - bend(x, signature))) for x in choices.T]
    return int(np.argmin(left))


def bend(at: Floats, value: Floats) -> Floats:
    """The smooth course of values (n) along a quantity (n)."""
    places = len(np.unique(np.round(at, 9)))
    degree = min(BEND_DEGREE, len(at) // POINTS_A_BEND, places - 1)
    return np.asarray(np.polynomial.Polynomial.fit(at, value, degree)(at)) if degree > 0 else np.zeros(len(at))


def _likest(signature: Floats, choices: Mapping[int, Floats]) -> int:
    """Which of some columns (v) a signature (v) follows best."""
    y = signature - signature.mean()

    def share(x: Floats) -> float:
        x = x - x.mean()
        return abs(float(x @ y)) / max(float(np.linalg.norm(x)), 1e-300)

    return max(choices, key=lambda j: share(choices[j]))
