"""Laws of the rig's motion are what one visit after the other tells."""

from itertools import pairwise

import numpy as np

from station.diagnosis.candidates.motion_kernels import turns_of
from station.diagnosis.candidates.motion_laws import RETURNS, SLIPS, motion_laws
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.data.residuals import initial_view
from tests.blind.bench import WHITE, hide
from tests.blind.recipes import recipe


def test_what_comes_again_and_what_sticks_until_it_slips() -> None:
    table, _ = hide(recipe(), None, 5, units=2, floor=WHITE)
    view = initial_view(reduce_samples(recipe(), table))
    visits = view.scene.visits
    found = [parts[0] for name, parts in motion_laws(view, {}) if name == "order"]
    for i in range(RETURNS[0]):
        np.testing.assert_array_equal(found[i], visits.visit % RETURNS[0] == i)
    angle, gone, stuck = np.linalg.norm(turns_of(view), axis=1), 0.0, list[float]()
    for i, before in enumerate(visits.previous):
        gone = gone + angle[i] if before >= 0 else 0.0
        stuck.append(gone - SLIPS[0] * np.floor(gone / SLIPS[0]))
    assert any(np.allclose(law, stuck, atol=1e-9) for law in found)
    assert all(not np.array_equal(one, other) for one, other in pairwise(found))
