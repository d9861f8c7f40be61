"""Kernels of the order of the visits: the place in it, the step from the previous visit, and where each came from."""

from collections.abc import Iterator

import numpy as np

from station.diagnosis.candidates.bank import Candidate
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.candidates.kernel_columns import (
    each_axis,
    grouped_kernel,
    kernel,
    levels_that_differ,
    ones,
    own_axis,
    steps_before,
    turns_of_nests,
)
from station.diagnosis.candidates.motion_kernels import turns_of, way_of
from station.diagnosis.data.residuals import ResidualView

#: Pallets of a carousel that come by turns.
PALLETS = 3


def order_kernels(view: ResidualView) -> Iterator[Candidate]:
    """Every second or third visit, the step from the previous visit on any axis, its size and sign, the length of the
    move, what each axis felt before that, and where it came from."""
    visits = view.scene.visits
    turn = each_axis(np.where(visits.visit % 2, -1.0, 1.0)[:, None])
    a = view.nominal_stimulus
    step, size = (each_axis(x) for x in (steps_before(view, a), np.abs(steps_before(view, a))))
    last_but_one = np.where(visits.previous >= 0, visits.previous[visits.previous], -1)
    earlier = own_axis(np.where(last_but_one[:, None] >= 0, a[last_but_one] - a, 0.0))
    turned = CauseColumns.in_bank(view, own_axis(a) * turn)
    pulled = CauseColumns.in_bank(view, each_axis(np.einsum("vi,vj->vij", steps_before(view, a), a).reshape(len(a), 9)))
    # About which axis a torque turned the part, and whether each axis came from above.
    torque = CauseColumns.in_bank(view, own_axis(np.cross(steps_before(view, a), a)))
    way = each_axis(np.sign(np.round(steps_before(view, a), 6)))
    length = np.linalg.norm(steps_before(view, a), axis=1)[:, None]
    pallets = each_axis((visits.visit % PALLETS)[:, None] == np.arange(PALLETS - 1))
    alone = [
        CauseColumns.in_bank(view, x)
        for x in (turn, step, size, each_axis(length), each_axis(length**2), earlier, way, pallets)
    ]
    for of in levels_that_differ(view, "unit", "common"):
        yield from (kernel("order", of, view, columns) for columns in alone)
        yield from (kernel("order*input", of, view, columns) for columns in (turned, pulled, torque))
    yield from came_from(view)


def came_from(view: ResidualView) -> Iterator[Candidate]:
    """Any number for each position before, or the one before that; and a nest whose rest depends on where it came from:
    the position before, or at each position the direction of the turn."""
    visits = view.scene.visits
    before = np.where(visits.previous >= 0, visits.position.code[visits.previous], len(visits.position.names))
    names = (*(f"previous:{n}" for n in visits.position.names), "previous:")
    earlier_still = np.where(visits.previous >= 0, before[visits.previous], len(visits.position.names))
    for code in (before, earlier_still):
        yield grouped_kernel("order", "previous", code.astype(np.int32), names, ones(view))
    for turn in turns_of_nests(view):
        # Where a nest comes to rest hangs on where it came from: on the position itself, or on the way that it turned.
        came = CauseColumns.in_bank(view, turn)
        yield grouped_kernel("order", "previous", before.astype(np.int32), names, came)
        for way in way_of(turns_of(view)).T if len(visits.position.names) > 1 else ():
            if way.any():
                yield kernel("order*position", "position", view, CauseColumns.in_bank(view, turn * way[:, None, None]))
