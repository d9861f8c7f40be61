"""Are a unit's samples evidence at all? Reasons that fail it, and notes that only tell."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.domain.capture.rest_detection import least_directed_stimulus
from station.domain.core.types import Floats, Reason, ReducedVisits
from station.domain.evaluation.unit_dwells import UnitDwells
from station.domain.noise.dwell_statistics import flat_topped
from station.domain.recipe import sensor
from station.domain.recipe.gravity import STANDARD
from station.domain.recipe.recipe import Recipe
from station.messages import Message

#: A mean reading this far from the nominal direction means another face.
FACE_DEG = 30.0
#: Factor between mean reading and stimulus from which on range or unit must be wrong.
SCALE = 1.5
#: Slower than this a rate table rests: what turns is the Earth, and offsets are larger.
AT_REST_DEG_S = 0.1
#: The dwell moved when its halves differ by more standard deviations.
MOVED = 6.0
#: A dwell this often at the end of the range is clipped.
FULL = 0.999


def reasons(recipe: Recipe, dwells: UnitDwells, visits: ReducedVisits) -> tuple[Reason, ...]:
    """Why this unit's samples are no evidence; nothing when they are sound."""
    return (
        *_stuck(recipe, visits),
        *_without_resolution(recipe, dwells),
        *_flat(recipe, dwells),
        *_clipped(recipe, dwells),
        *_moved(recipe, dwells),
        *_stimulus(recipe, visits),
    )


def notes(recipe: Recipe, dwells: UnitDwells) -> tuple[Message, ...]:
    """What a person should know although it fails nothing."""
    return (*_rejected(dwells), *_coarse(recipe, dwells), *_drifts(recipe, dwells), *_single(dwells))


def _stuck(recipe: Recipe, visits: ReducedVisits) -> Iterator[Reason]:
    for i, axis in enumerate("xyz"[: recipe.axes]):
        poses = {(p, s) for p, s in zip(visits.position, visits.seating, strict=True)}
        if len(poses) > 1 and not visits.std[:, i].any() and np.ptp(visits.mean[:, i]) == 0:
            value = float(visits.mean[0, i])
            yield Reason(Message("axis-stuck", axis=axis, value=value, unit=recipe.unit), check="stuck")


def _clipped(recipe: Recipe, dwells: UnitDwells) -> Iterator[Reason]:
    full = recipe.device.full_scale
    if full is None:
        return
    extreme = np.maximum(dwells.dwells.high, -dwells.dwells.low)
    for v, i in np.argwhere(extreme >= FULL * full):
        where = {"axis": "xyz"[i], "position": dwells.position[v]}
        message = Message("axis-clipped", limit=full, unit=recipe.unit, **where)
        yield Reason(message, float(extreme[v, i]), full, recipe.unit, check="clipped")


def _without_resolution(recipe: Recipe, dwells: UnitDwells) -> Iterator[Reason]:
    """Readings that never change are known no better than their step, which somebody must state."""
    d = dwells.dwells
    constant = (d.high == d.low).all(axis=0) & (d.count > 1).any() & (np.arange(3) < recipe.axes)
    if recipe.device.lsb == 0 and (constant & (dwells.step == 0)).any():
        yield Reason(Message("readings-without-resolution"), None, None, recipe.unit, "resolution")


def _flat(recipe: Recipe, dwells: UnitDwells) -> Iterator[Reason]:
    """Dwells at the end of the range, which no data sheet need state: see dwell_statistics.flat_topped."""
    for v, i in np.argwhere(flat_topped(dwells.dwells)[:, : recipe.axes]):
        value = float(dwells.dwells.mean[v, i])
        shown = Message("axis-flat-topped", axis="xyz"[i], value=value, unit=recipe.unit, position=dwells.position[v])
        yield Reason(shown, value, None, recipe.unit, "clipped")


def _moved(recipe: Recipe, dwells: UnitDwells) -> Iterator[Reason]:
    """A drift within a dwell fails the unit only where it is more than the residual may be."""
    limit = recipe.limits.residual
    if limit is None:
        return
    for v, i in np.argwhere(_drifted(dwells) & (np.abs(dwells.dwells.drift) > limit)):
        size = float(dwells.dwells.drift[v, i])
        where = {"axis": "xyz"[i], "position": dwells.position[v]}
        message = Message("axis-moved", value=-size, unit=recipe.unit, limit=limit, **where)
        yield Reason(message, abs(size), limit, recipe.unit, check="not-still")


def _stimulus(recipe: Recipe, visits: ReducedVisits) -> Iterator[Reason]:
    """Readings of the wrong size, or of another face than the one that was asked for."""
    size = np.linalg.norm(visits.mean, axis=1)
    known = np.asarray(np.isfinite(visits.true).all(axis=1))
    wanted = np.linalg.norm(np.where(known[:, None], visits.true, recipe.reference.strength() * np.eye(3)[2]), axis=1)
    if not (wanted > 0).all():
        return
    if recipe.reference.source == "rate" and wanted.max() < AT_REST_DEG_S:
        return
    # At a weak stimulus, such as a gyroscope's rest, the offset decides what is read.
    strong = np.asarray(wanted >= least_directed_stimulus(float(wanted.max()), recipe)) | ~known
    if not strong.any():
        return
    ratio = float(np.median((size / wanted)[strong]))
    if sensor.of(recipe).large_offset:
        # An offset may make readings many times as large as what is measured, and never small in every pose.
        if len(visits) > 1 and ratio < 1 / SCALE and not known.all():
            yield Reason(Message("readings-wrong-scale", ratio=ratio), ratio, SCALE, check="scale")
    elif len(visits) > 1 and not 1 / SCALE < ratio < SCALE:
        id_ = "readings-in-m-s2" if abs(ratio / STANDARD - 1) < 0.05 else "readings-wrong-scale"
        yield Reason(Message(id_, ratio=ratio), ratio, SCALE, check="scale")
    elif known.all():
        yield from _faces(visits, wanted, size, strong)


def _faces(visits: ReducedVisits, wanted: Floats, size: Floats, strong: NDArray[np.bool_]) -> Iterator[Reason]:
    found = visits.mean / np.maximum(size, 1e-300)[:, None]
    nominal = visits.true / wanted[:, None]
    cosine = np.einsum("vi,vi->v", found, nominal)
    for v in np.flatnonzero(strong & (cosine < np.cos(np.deg2rad(FACE_DEG)))):
        angle = float(np.degrees(np.arccos(np.clip(cosine[v], -1, 1))))
        name, nearest = visits.position[v], visits.position[int(np.argmax(nominal @ found[v]))]
        message = Message("direction-wrong", position=name, angle_deg=angle)
        if nearest != name:
            message = Message("direction-of-other", position=name, angle_deg=angle, nearest=nearest)
        yield Reason(message, angle, FACE_DEG, "deg", check="wrong-face")


def _drifted(dwells: UnitDwells) -> NDArray[np.bool_]:
    return np.asarray(np.abs(dwells.dwells.drift_z) > MOVED)


def _rejected(dwells: UnitDwells) -> Iterator[Message]:
    d = dwells.dwells
    if d.rejected.any():
        v = int(np.argmax(d.rejected))
        yield Message(
            "readings-left-out",
            left_out=int(d.rejected.sum()),
            count=int(d.count.sum()),
            place=_place(dwells, v),
            left_out_there=int(d.rejected[v]),
            count_there=int(d.count[v]),
        )


def _coarse(recipe: Recipe, dwells: UnitDwells) -> Iterator[Message]:
    if (dwells.dwells.count == 1).all():  # what scatters from visit to visit tells how far the steps matter
        return
    left = dwells.quantisation if dwells.rounding is None else dwells.rounding
    for i, axis in enumerate("xyz"[: recipe.axes]):
        rounding, noise = float(left[:, i].max()), float(dwells.dwells.variance[:, i].max())
        if rounding > noise and dwells.step[i] > 0:
            error = float(np.sqrt(3 * rounding))
            step = float(dwells.step[i])
            yield Message("steps-beyond-noise", axis=axis, step=step, error=error, unit=recipe.unit)
        elif recipe.device.lsb > 0 and dwells.step[i] > 1.5 * recipe.device.lsb:
            step = float(dwells.step[i])
            yield Message("steps-beyond-sheet", axis=axis, step=step, unit=recipe.unit, sheet=recipe.device.lsb)


def _drifts(recipe: Recipe, dwells: UnitDwells) -> Iterator[Message]:
    drifted = _drifted(dwells)
    if drifted.any():
        size = np.where(drifted, np.abs(dwells.dwells.drift), 0.0)
        v, i = np.unravel_index(int(np.argmax(size)), size.shape)
        yield Message(
            "readings-drift",
            drifting=int(drifted.any(axis=1).sum()),
            visits=len(dwells),
            axis="xyz"[i],
            place=_place(dwells, v),
            value=-float(dwells.dwells.drift[v, i]),
            unit=recipe.unit,
        )


def _single(dwells: UnitDwells) -> Iterator[Message]:
    if (dwells.dwells.count < 2).all():
        yield Message("visits-of-one-reading")


def _place(dwells: UnitDwells, v: Any) -> Message:
    return Message("visit-place", position=dwells.position[v], run=int(dwells.run[v]), visit=int(dwells.visit[v]))
