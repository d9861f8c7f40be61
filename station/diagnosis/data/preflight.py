"""Before anything is fitted: what samples are, what their sensor is, and which visits say nothing of it.

`calibrate` and `diagnose` share it. It leaves out visits that move or hold two poses, infers what the recipe's data
sheet does not state, and refuses what is no tumble.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data import (
    column_checks,
    corrupt_values,
    field_direction,
    preflight_checks,
    stays,
    visit_motion,
    visit_places,
)
from station.diagnosis.data.faults.gross_fault import GrossFault
from station.diagnosis.data.row_place import where_is
from station.domain.capture.rest_segments import orientations
from station.domain.core.types import Floats, SampleTable
from station.domain.evaluation.unit_dwells import sort_table, visit_boundaries
from station.domain.recipe.recipe import Recipe
from station.domain.recognition import sheet
from station.domain.recognition.quantities import sphere
from station.domain.recognition.sheet import InferredSheet
from station.errors import SamplesError
from station.messages import Message, render

#: What a recipe's data sheet may state, and what is inferred where it does not.
SHEET_KEYS = ("rate_hz", "lsb", "noise_density")
#: Rows were shuffled where this share of a visit's stamps, or more, is before the one ahead of it.
SHUFFLED = 0.2
#: Why a part of a visit is left out.
PARTLY = "visit-moves-partly"
#: Orientations of which no pose is known that leave anything to see beside three offsets and three gains.
LEAST_ORIENTATIONS = 7


@dataclass(frozen=True, slots=True)
class LeftOutVisit:
    """A visit that is not used, and why."""

    unit: str
    run: int
    visit: int
    reason: Message

    @property
    def of(self) -> str:
        """As a finding names a visit."""
        return f"visit:{self.unit}/{self.run}/{self.visit}"

    def document(self) -> dict[str, Any]:
        """As JSON keeps it."""
        return {"of": self.of, "reason": render(self.reason), "message": self.reason.document()}


@dataclass(frozen=True, slots=True, eq=False)
class Preflight:
    """sheet: what the readings tell of the sensor; units, visits: how many; poses: orientations of one unit, at most;
    magnitude: least, median and greatest size of a visit's mean; temperature_degC: least and greatest, or None;
    inferred: what no sheet states; left_out, remarks: for a person; simulated: units whose rows are marked so;
    faults: causes that the visits left out are."""

    sheet: InferredSheet
    units: int
    visits: int
    poses: int
    magnitude: tuple[float, float, float]
    temperature_degC: tuple[float, float] | None
    inferred: tuple[str, ...]
    left_out: tuple[LeftOutVisit, ...] = ()
    remarks: tuple[Message, ...] = field(default=())
    simulated: int = 0
    faults: tuple[GrossFault, ...] = ()

    def document(self) -> dict[str, Any]:
        """As JSON keeps it."""
        found = self.sheet
        low, middle, high = self.magnitude
        return {
            "units": self.units,
            "simulated": self.simulated,
            "visits": self.visits,
            "poses": self.poses,
            "rate_hz": found.rate_hz,
            "jitter_s": found.jitter_s,
            "noise": found.noise.tolist(),
            "lsb": found.lsb.tolist(),
            "full_scale": found.full_scale,
            "magnitude": {"median": middle, "least": low, "greatest": high},
            "temperature_degC": None if self.temperature_degC is None else list(self.temperature_degC),
            "inferred": list(self.inferred),
            "left_out": [one.document() for one in self.left_out],
            "remarks": [{**m.document(), "sentence": render(m)} for m in self.remarks],
        }


def inspect(recipe: Recipe, table: SampleTable) -> tuple[Preflight, SampleTable]:
    """What samples are, and those of them that count. Errors: SamplesError where they are of no tumble."""
    rows, table = len(table), in_order(table)
    again = (Message("samples-written-again", rows=rows - len(table), total=rows),) if len(table) < rows else ()
    preflight_checks.check_positions(table, *visit_boundaries(table))
    table, corrupt = corrupt_values.repaired(recipe, table)
    table, unused = column_checks.without_misnamed(recipe, table)
    table, steps = stays.split_at_steps(recipe, table)
    begin, end = visit_boundaries(table)
    mean = np.add.reduceat(table.reading, begin, axis=0) / (end - begin)[:, None]
    number = np.repeat(np.arange(len(begin)), end - begin)
    found = sheet.infer(table.reading, table.time_s, number)
    unit = table.unit.code[begin]
    size = preflight_checks.stimulus_size(recipe, mean)
    gone, lost = _moving(recipe, table, found, size)
    gone, lost, misplaced = _elsewhere(recipe, table, mean, gone, lost)
    preflight_checks.check_signal(recipe, found, size)
    out = np.logical_and.reduceat(gone, begin)
    if (gone & ~out[number]).any():
        kept = np.add.reduceat(~gone, begin)[:, None]
        still = np.add.reduceat(np.where(gone[:, None], 0.0, table.reading), begin, axis=0)
        mean = np.where(kept > 0, still / np.maximum(kept, 1), mean)
    poses = _poses(recipe, mean[~out], unit[~out])
    turned = preflight_checks.one_turned_unit(recipe, mean[~out], unit[~out])
    preflight_checks.check_poses(recipe, poses, turned)
    preflight_checks.check_magnitude(recipe, mean[~out], unit[~out], found)
    if poses < LEAST_ORIENTATIONS:
        preflight_checks.check_axes_agree(recipe, table, mean[~out], unit[~out])
    warm = table.values.get("temperature_degC")
    warm = None if warm is None or np.isnan(warm).all() else warm
    lengths = np.linalg.norm(mean[~out] if (~out).any() else mean, axis=1)
    result = Preflight(
        sheet=found,
        units=len(np.unique(unit)),
        visits=len(begin),
        poses=poses,
        magnitude=(float(lengths.min()), float(np.median(lengths)), float(lengths.max())),
        temperature_degC=None if warm is None else (float(np.nanmin(warm)), float(np.nanmax(warm))),
        inferred=inferred_keys(recipe),
        left_out=lost,
        remarks=(
            *again,
            *corrupt,
            *unused,
            *preflight_checks.remarks(recipe, table, (begin, mean, out), found, turned),
            *preflight_checks.stepped(recipe, table, begin, mean, steps),
            *field_direction.field_remarks(recipe, table, begin[~out], mean[~out], unit[~out]),
        ),
        simulated=_simulated(table, begin),
        faults=misplaced,
    )
    return result, table[~gone] if gone.any() else table


def _moving(
    recipe: Recipe, table: SampleTable, found: InferredSheet, size: float
) -> tuple[NDArray[np.bool_], tuple[LeftOutVisit, ...]]:
    """Which rows of a sorted table move or belong to two poses at once, and why they are left out: whole visits, but of
    a stay that was cut into visits the stretches of it that move. Errors: SamplesError where most do."""
    cut = stays.stretches(recipe, table)
    begin, end = visit_boundaries(cut)
    motion = visit_motion.of(cut, begin, end, found.noise)
    unit = cut.unit.code[begin]
    preflight_checks.check_rest(motion, unit, size)
    moving, merged = visit_motion.moving(motion, unit, size)
    gone = np.repeat(moving | merged, end - begin)
    first, _ = visit_boundaries(table)
    whole = np.logical_and.reduceat(gone, first)[np.searchsorted(first, begin, side="right") - 1]
    lost = [
        _left_out(table, (int(begin[v]), int(end[v])), motion, merged, v, whole=bool(whole[v]))
        for v in np.flatnonzero(moving | merged).tolist()
    ]
    # Of a visit that is gone whole one stretch tells why.
    once = {(one.of, one.reason if one.reason.id == PARTLY else None): one for one in reversed(lost)}
    return gone, tuple(once.values())[::-1]


def _elsewhere(
    recipe: Recipe, table: SampleTable, mean: Floats, gone: NDArray[np.bool_], lost: tuple[LeftOutVisit, ...]
) -> tuple[NDArray[np.bool_], tuple[LeftOutVisit, ...], tuple[GrossFault, ...]]:
    """The rows that are left out and why, with those of visits whose means (v, 3) are of another position, and the
    fault that these are. Errors: SamplesError where no visit is left."""
    begin, end = visit_boundaries(table)
    found = visit_places.elsewhere(recipe, table, begin, mean)
    if not found:
        return gone, lost, ()
    for visit in found:
        row, last = int(begin[visit.visit]), int(end[visit.visit])
        one = _lost(table, row, Message("visit-at-another-position", **where_is(table, row), other=visit.name))
        gone[row:last] = True
        # Called after the one before it, it was taken for one stay with that in two poses.
        lost = (*(each for each in lost if each.of != one.of), one)
    if gone.all():
        raise SamplesError("no-visit-as-called", reason=lost[-1].reason)
    return gone, lost, (visit_places.as_cause(table, found),)


def in_order(table: SampleTable) -> SampleTable:
    """The table sorted by unit, run and visit, each visit in the order of time, without rows that a table holds again
    because it was joined with a copy of itself."""
    return _in_order_of_time(_without_copies(sort_table(table)))


def _without_copies(table: SampleTable) -> SampleTable:
    """The sorted table without samples of which the same visit has the same stamp and reading before, not directly: a
    frame that a bus repeats follows the one that it repeats."""
    begin, end = visit_boundaries(table)
    visit = np.repeat(np.arange(len(begin)), end - begin)
    if not np.any((np.diff(table.time_s) < 0) & (np.diff(visit) == 0)):
        return table
    order = np.lexsort((table.time_s, visit))
    same = (np.diff(visit[order]) == 0) & (np.diff(table.time_s[order]) == 0) & (np.diff(order) > 1)
    same &= (table.reading[order[1:]] == table.reading[order[:-1]]).all(axis=1)
    return table[np.delete(np.arange(len(table)), order[1:][same])] if same.any() else table


def _in_order_of_time(table: SampleTable) -> SampleTable:
    """The table with each visit's samples in the order of their stamps, where many go back: rows were shuffled. Few
    are late stamps, and stand in the order of arrival."""
    begin, end = visit_boundaries(table)
    inside = np.ones(max(len(table) - 1, 0), bool)
    inside[begin[1:] - 1] = False
    if not inside.any() or np.mean(np.diff(table.time_s)[inside] < 0) < SHUFFLED:
        return table
    return table[np.lexsort((table.time_s, np.repeat(np.arange(len(begin)), end - begin)))]


def check_orientations(recipe: Recipe, found: Preflight) -> None:
    """Errors: SamplesError where only the magnitude is known, and the orientations are too few for offset and gain of
    each axis: nothing else can be told from them. Temperatures may show themselves in few."""
    warm = found.temperature_degC
    heated = warm is not None and warm[1] - warm[0] > preflight_checks.HEATED_DEGC
    known = recipe.pose_known or recipe.reference.source == "rate"
    if not known and not heated and found.poses < LEAST_ORIENTATIONS:
        raise SamplesError("too-few-orientations", poses=found.poses, needed=LEAST_ORIENTATIONS)


def _left_out(
    table: SampleTable,
    rows: tuple[int, int],
    motion: visit_motion.VisitMotion,
    merged: NDArray[np.bool_],
    v: int,
    *,
    whole: bool,
) -> LeftOutVisit:
    """Why stretch v, rows first to one past the last, is left out; whole: with all of its visit."""
    row, end = rows
    values: Mapping[str, Any] = where_is(table, row)
    moves = float(max(motion.range[v], motion.scatter[v]))
    if not whole:
        lasts_s = float(table.time_s[end - 1] - table.time_s[row])
        reason = Message(PARTLY, **values, range=moves, start_s=float(table.time_s[row]), lasts_s=lasts_s)
    elif merged[v]:
        reason = Message("visit-of-two-poses", **values, step=float(motion.step[v]))
    else:
        reason = Message("visit-moves", **values, range=moves)
    return _lost(table, row, reason)


def _lost(table: SampleTable, row: int, reason: Message) -> LeftOutVisit:
    """The visit of a row, left out."""
    return LeftOutVisit(table.unit.names[table.unit.code[row]], int(table.run[row]), int(table.visit[row]), reason)


def _poses(recipe: Recipe, mean: Floats, unit: NDArray[np.int32]) -> int:
    """Orientations of the unit that has the most; about the middle of its readings, whatever its offset."""
    most = 0
    for u in np.unique(unit)[:200]:
        own = mean[unit == u]
        turned = np.ptp(own, axis=0).max(initial=0.0) > preflight_checks.STIMULATED * recipe.reference.strength()
        centre = sphere(own)[0] if turned and not recipe.pose_known else np.zeros(3)
        most = max(most, int(orientations(own - centre).max(initial=-1)) + 1)
    return most


def inferred_keys(recipe: Recipe) -> tuple[str, ...]:
    """What the recipe's data sheet leaves to the readings."""
    stated = recipe.device.model_fields_set if "device" in recipe.model_fields_set else set()
    # A step of 0 states none.
    return tuple(key for key in SHEET_KEYS if key not in stated or (key == "lsb" and recipe.device.lsb == 0))


def with_sheet(recipe: Recipe, of: Preflight) -> Recipe:
    """The recipe with what its data sheet leaves out, and what it states of another device, taken from the readings."""
    found, remarked = of.sheet, {m.id for m in of.remarks}
    wrong = ["rate_hz"] if "rate-differs" in remarked else []
    missing = [*inferred_keys(recipe), *(SHEET_KEYS if "sheet-of-another-device" in remarked else wrong)]
    known: dict[str, float] = {}
    if "rate_hz" in missing and found.rate_hz:
        known["rate_hz"] = found.rate_hz
    if "lsb" in missing:
        known["lsb"] = float(found.lsb.max())
    if "noise_density" in missing and found.noise.any():
        rate_hz = known.get("rate_hz", recipe.device.rate_hz)
        known["noise_density"] = float(np.median(found.noise) / np.sqrt(rate_hz / 2))
    if not known:
        return recipe
    values = {name: getattr(recipe.device, name) for name in type(recipe.device).model_fields} | known
    # What the readings tell stays unstated: no reading is judged by what was taken from it.
    stated = recipe.device.model_fields_set - known.keys()
    device = type(recipe.device).model_construct(_fields_set=stated, **values)
    return recipe.model_copy(update={"device": device})


def _simulated(table: SampleTable, begin: NDArray[np.int64]) -> int:
    mark = table.labels.get("simulated")
    if mark is None:
        return 0
    marked = np.array([bool(name) for name in mark.names], bool)[mark.code[begin]]
    return len(np.unique(table.unit.code[begin][marked]))


def lines(found: Preflight, unit: str) -> Iterator[Message]:
    """What was understood, for a person: one line of numbers, then what is left out and remarked."""
    if found.simulated:
        yield Message("simulated-units")
    noise, lsb = (tuple(f"{v:.3g}" for v in values) for values in (found.sheet.noise, found.sheet.lsb))
    yield Message(
        "preflight-visits", units=found.units, visits=found.visits, poses=found.poses,
        magnitude=found.magnitude[1], unit=unit,
    )  # fmt: skip
    if found.sheet.rate_hz:
        yield Message("preflight-rate", rate_hz=found.sheet.rate_hz, jitter_ms=1e3 * found.sheet.jitter_s)
        yield Message("preflight-noise", noise=noise, lsb=lsb, unit=unit)
    else:
        yield Message("preflight-single-readings", lsb=lsb, unit=unit)
    if names := _inferred_names(found):
        yield Message("preflight-inferred", names=names)
    if found.temperature_degC is not None:
        yield Message("preflight-temperature", low=found.temperature_degC[0], high=found.temperature_degC[1])
    yield from found.remarks
    shown = 5
    yield from (one.reason for one in found.left_out[:shown])
    if len(found.left_out) > shown:
        yield Message("visits-left-out-more", count=len(found.left_out) - shown)


def _inferred_names(found: Preflight) -> tuple[Message, ...]:
    """The names of what no sheet states and the readings tell; single readings tell neither rate nor noise."""
    names = {"rate_hz": "sheet-rate", "noise_density": "sheet-noise", "lsb": "sheet-steps"}
    readable = ("lsb",) if found.sheet.rate_hz is None else tuple(names)
    return tuple(Message(names[key]) for key in names if key in found.inferred and key in readable)


def merge(parts: list[Preflight]) -> Preflight:
    """One of the portions of a table; the sensor as the first portion tells."""
    first = parts[0]
    warm = [p.temperature_degC for p in parts if p.temperature_degC is not None]
    weights = np.array([p.visits for p in parts], float)
    middle = float(np.average([p.magnitude[1] for p in parts], weights=weights))
    return Preflight(
        sheet=first.sheet,
        units=sum(p.units for p in parts),
        visits=sum(p.visits for p in parts),
        poses=max(p.poses for p in parts),
        magnitude=(min(p.magnitude[0] for p in parts), middle, max(p.magnitude[2] for p in parts)),
        temperature_degC=(min(w[0] for w in warm), max(w[1] for w in warm)) if warm else None,
        inferred=first.inferred,
        left_out=tuple(one for p in parts for one in p.left_out),
        remarks=tuple(dict.fromkeys(m for p in parts for m in p.remarks)),
        simulated=sum(p.simulated for p in parts),
    )
