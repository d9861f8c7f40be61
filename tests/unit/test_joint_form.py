"""Weights of two parameters together: those of an oblique Gauss hill, of its bounds, and of two hills."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from station.diagnosis.candidates.shape import FormEstimate
from station.diagnosis.results.joint_form import JointForm, weigh_together
from station.domain.core.types import Floats

MIDDLE = np.log([0.1, 6.0])
WIDE = ((math.log(0.01), math.log(2.0)), (math.log(1.0), math.log(30.0)))


def _hill(
    common: float, spread: tuple[float, float], middle: Floats = MIDDLE, height: float = 0.0
) -> tuple[list[FormEstimate], Callable[[Floats], Floats]]:
    """Evidence of a Gauss hill whose parameters have so much in common; and the best values with the curvature of each
    alone, as they are found one after the other."""
    cov = np.outer(spread, spread) * np.array([[1.0, common], [common, 1.0]])
    bend = np.linalg.inv(cov)
    best = [
        FormEstimate(name, float(v), float(v / np.sqrt(b)))
        for name, v, b in zip(("tau_s", "frequency_hz"), np.exp(middle), np.diag(bend), strict=True)
    ]
    return best, lambda logs: height - 0.5 * np.einsum("ni,ik,nk->n", logs - middle, bend, logs - middle)


@pytest.mark.parametrize("common", [0.0, 0.5, -0.9])
def test_an_oblique_hill_gives_its_deviations_back(common: float) -> None:
    best, evidence = _hill(common, (0.2, 0.01))
    found = weigh_together(best, WIDE, evidence)
    logs = np.log(found.values) - MIDDLE
    # Beyond 6 nats, where the lattice ends, lies exp(−6) · 7 of a variance; one parameter after the other would show
    # √(1 − common²) of each deviation.
    for i, (e, spread) in enumerate(zip(found.estimates, (0.2, 0.01), strict=True)):
        assert e.std / e.value == pytest.approx(spread, rel=0.02)
        assert math.log(e.value) == pytest.approx(MIDDLE[i], abs=1e-6)
    assert found.weights @ (logs[:, 0] * logs[:, 1]) == pytest.approx(common * 0.2 * 0.01, abs=0.03 * 0.2 * 0.01)
    assert found.nats == pytest.approx(0.5 * math.log(1 - common**2) + math.log(2 * math.pi * 0.2 * 0.01), abs=0.02)


def test_no_value_lies_beyond_the_bounds() -> None:
    best, evidence = _hill(0.0, (0.5, 0.5))
    found = weigh_together(best, ((MIDDLE[0] - 0.3, MIDDLE[0] + 3), (MIDDLE[1] - 3, MIDDLE[1] + 3)), evidence)
    assert np.log(found.values[:, 0]).min() >= MIDDLE[0] - 0.3 - 1e-9
    assert found.estimates[0].value > 0.1


def test_two_hills_give_the_likelier_one_with_the_other_in_its_deviation() -> None:
    other = MIDDLE + np.array([0.0, 0.4])
    peaks = [weigh_together(both[0], WIDE, both[1]) for both in (
        _hill(0.0, (0.1, 0.01)), _hill(0.0, (0.1, 0.01), other, height=-math.log(3)))]  # fmt: skip
    found = JointForm.of_peaks(peaks[::-1])
    # A third as high is a quarter of all.
    assert found.estimates[1].value == pytest.approx(6.0, rel=1e-3)
    assert found.estimates[1].std / 6.0 == pytest.approx(math.sqrt(0.25 * 0.4**2 + 0.01**2), rel=0.02)
    assert found.weights.sum() == pytest.approx(1.0)
    assert peaks[0].holds(np.exp(MIDDLE + np.array([0.1, 0.0])))
    assert not peaks[0].holds(np.exp(other))
