"""Kernels of changes within the dwells: any course from block to block, or what fades after each arrival."""

from collections.abc import Iterable, Iterator

import numpy as np

from station.diagnosis.candidates.bank import Candidate
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.candidates.kernel_columns import (
    each_axis,
    kernel,
    levels_that_differ,
    own_axis,
    scaled,
    steps_before,
)
from station.diagnosis.candidates.motion_kernels import turns_of, way_of
from station.diagnosis.candidates.temperature_memory import MIN_TEMPERATURE_RANGE
from station.diagnosis.data.reduce import mean_and_contrasts
from station.diagnosis.data.residuals import ResidualView
from station.domain.core.types import Floats

#: The kernel of what changes within the dwells.
MOVING_KERNEL = "dwell-phase"
#: That of one course, and the share of a dwell after which a third of it is left.
FADING_KERNEL, FADE_SHARE = "dwell-phase/fading", 0.25

#: Shares of a dwell from which something climbs, up to which it is there, at which it is largest; its waves in a dwell.
CLIMBS, ENDS, TOPS, WAVES = (0.0, 0.3, 0.6), (0.06, 0.12, 0.25, 0.4, 0.7), (0.05, 0.12, 0.3), (0.8, 1.25)
#: Points of a block at which a course is looked up.
POINTS = 24


def dwell_kernels(view: ResidualView) -> Iterator[Candidate]:
    """Any course within the dwell, the same at each visit or in proportion to the last move or the input; and what
    fades, in proportion to a slow covariate, the drive, the product of two of them, or the path of the move."""
    count = view.reduced.count
    if view.reduced.contrast.shape[1] == 0 or not np.any(count[:, 1:]):
        return
    a = view.nominal_stimulus
    step = steps_before(view, a)
    slow, driven = list(_slow_courses(view)), list(_driven_courses(view))
    sizes = np.ones_like(a), step, a
    blocks = np.arange(count.shape[1])
    yield from _kernels(MOVING_KERNEL, (blocks[:, None] == blocks[:-1]).astype(float), map(own_axis, sizes), view)
    fading = [*map(each_axis, (*slow, *driven)), *(own_axis(step * x) for x in slow)]
    if view.scene.recipe.pose_known:
        fading.append(each_axis(way_of(turns_of(view))))
    middle = np.mean((np.cumsum(count, axis=1) - count / 2) / count.sum(1, keepdims=True), axis=0)
    yield from _kernels(FADING_KERNEL, np.exp(-middle / FADE_SHARE)[:, None], fading, view)


def courses_in_dwells(view: ResidualView) -> Iterator[CauseColumns]:
    """What changes from block to block as nothing that dies away does, the same at each visit or in proportion to the
    last move."""
    count, a = view.reduced.count, view.nominal_stimulus
    edges = np.append(0.0, view.reduced.edges)
    within = edges[:-1, None] + np.diff(edges)[:, None] * (np.arange(POINTS) + 0.5) / POINTS
    courses = _courses(within).mean(axis=1)
    mean, contrast = mean_and_contrasts(np.broadcast_to(courses, (len(count), *courses.shape)), count)
    for size in (np.ones_like(a), steps_before(view, a)):
        for still, moving in zip(mean.T, contrast.transpose(2, 0, 1), strict=True):
            moves = own_axis(moving[..., None] * size[:, None])
            yield CauseColumns.in_bank(view, own_axis(still[:, None] * size), moves)


def _courses(x: Floats) -> Floats:
    """Courses (…, c) at shares of a dwell: what climbs, ends, rises and falls, or swings."""
    climbing, ending = [np.maximum(x - at, 0.0) for at in CLIMBS], [1.0 * (x < at) for at in ENDS]
    falling = [x * np.exp(-x / at) for at in TOPS]
    swinging = [f(2 * np.pi * waves * x) for waves in WAVES for f in (np.sin, np.cos)]
    return np.stack([*climbing, *ending, *falling, *swinging], axis=-1)


def _kernels(name: str, courses: Floats, sizes: Iterable[Floats], view: ResidualView) -> Iterator[Candidate]:
    """Courses (blocks, c) of sizes (v, 3, f) each."""
    count = view.reduced.count
    mean, contrast = mean_and_contrasts(np.broadcast_to(courses, (len(count), *courses.shape)), count)
    for size in sizes:
        still = np.einsum("vp,vif->vipf", mean, size).reshape(len(size), 3, -1)
        moving = np.einsum("vbp,vif->vbipf", contrast, size).reshape(*contrast.shape[:2], 3, -1)
        columns = CauseColumns.in_bank(view, still, moving)
        for of in levels_that_differ(view, "unit", "common"):
            yield kernel(name, of, view, columns)


def _slow_courses(view: ResidualView) -> Iterator[Floats]:
    """Time and temperature (v, 1) from -1 to 1, as far as they vary."""
    T = view.scene.temperature_degC
    for x in (view.scene.time_s, None if T is None or np.ptp(T) < MIN_TEMPERATURE_RANGE else T):
        if x is not None and np.ptp(x) > 0:
            yield scaled(x)[:, None]


def _driven_courses(view: ResidualView) -> Iterator[Floats]:
    """The motors' drive, and how far they turned (v, 1), as far as known."""
    motor = view.scene.motor
    if motor is not None and np.ptp(motor) > 0:
        yield motor[:, None]
    if view.scene.recipe.pose_known:
        yield np.linalg.norm(turns_of(view), axis=1)[:, None]
