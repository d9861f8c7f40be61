"""Forms between those of the laws are followed by one of them."""

from collections.abc import Callable

import numpy as np
import pytest

from station.diagnosis.candidates.law_forms import curves_by_covariate, laws_of_view, steps_of_stimulus
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.data.residuals import ResidualView, initial_view
from station.domain.core.types import Floats
from tests.blind.bench import WHITE, hide
from tests.blind.recipes import recipe

Form = Callable[[Floats, Floats], Floats]


@pytest.fixture(scope="module")
def view() -> ResidualView:
    table, _ = hide(recipe(), None, 5, units=1, floor=WHITE)
    return initial_view(reduce_samples(recipe(), table))


@pytest.mark.parametrize(
    ("covariate", "form", "most"),
    [
        ("input", lambda a, step: np.exp(-4.0 * a), 0.01),
        ("input", lambda a, step: np.exp(2.2 * a), 0.01),
        ("order", lambda a, step: np.abs(np.roll(step, 1, axis=1)) - 0.4 * np.abs(np.roll(step, 2, axis=1)), 0.01),
        ("order", lambda a, step: np.sign(step) * (np.abs(step) > 0.6), 0.1),
        ("order", lambda a, step: np.sign(step) * np.maximum(np.abs(step) - 0.65, 0.0), 0.03),
    ],
)
def test_a_form_is_followed_by_a_law_of_its_covariate(
    view: ResidualView, covariate: str, form: Form, most: float
) -> None:
    """On each axis a law leaves a small share of its squares beside an offset and a gain."""
    a = view.nominal_stimulus
    step = np.where(np.abs(x := steps_of_stimulus(view)) > 1e-6, x, 0.0)
    true, left = form(a, step), list[float]()
    for name, parts in laws_of_view(view, curves_by_covariate(view)):
        if name == covariate:
            left.append(max(_left(true[:, i], [part[:, i] for part in parts], a[:, i]) for i in range(3)))
    assert min(left) < most


def _left(true: Floats, parts: list[Floats], a: Floats) -> float:
    """The share of the squares beside offset and gain that columns leave."""
    known = np.stack([np.ones(len(a)), a], axis=1)
    rest, beside = (_beside(x, known) for x in (true[:, None], np.stack(parts, axis=1)))
    return float(np.sum(_beside(rest, beside) ** 2) / np.sum(rest**2))


def _beside(x: Floats, columns: Floats) -> Floats:
    return np.asarray(x - columns @ np.linalg.lstsq(columns, x, rcond=None)[0])
