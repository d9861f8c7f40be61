"""What a next run promises."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.diagnosis.planning.promise import Promise, TiedCauses

NAMES = ("a", "b", "c")
apart = st.floats(0.0, 30.0)


def promised(values: list[float], likely: dict[str, float], d: float = np.inf) -> Promise:
    return Promise((TiedCauses.of(NAMES, d, likely),), dict(zip(permutations(NAMES, 2), values, strict=True)))


@given(st.lists(apart, min_size=6, max_size=6), st.lists(st.floats(0.01, 1.0), min_size=3, max_size=3), apart)
def test_more_apart_promises_more(values: list[float], likely: list[float], more: float) -> None:
    weights = dict(zip(NAMES, likely, strict=True))
    one, two = (promised(v, weights) for v in (values, [x + more for x in values]))
    assert 0.0 <= one.certainty <= two.certainty <= 1.0


def test_a_pair_planned_at_the_limit_is_parted_in_half_of_the_cases() -> None:
    assert promised([3.29] * 6, {}).certainty == pytest.approx(0.5)
    assert promised([5.0] * 6, {}).certainty == pytest.approx(0.956, abs=0.001)


def test_evidence_within_a_tie_counts_by_half() -> None:
    """A member that is hopeless by its evidence is still one that these data cannot tell from the leader."""
    assert TiedCauses.of(NAMES, 9.0, {"a": 0.6, "b": 0.2}).likely == pytest.approx([0.5417, 0.2917, 0.1667], abs=1e-4)
    assert TiedCauses.of(NAMES, 9.0, {"a": 0.8, "b": 0.2}, (3, 3, 54)).likely == pytest.approx([0.65, 0.35, 0.0])
    assert TiedCauses.of(NAMES, 9.0, {}).likely == pytest.approx([1 / 3] * 3)


def test_a_cause_that_another_always_imitates_is_promised_as_little_as_it_is_likely() -> None:
    """Errors of all positions can look like any tilt of the base, and not the other way round."""
    tie = TiedCauses.of(("base-tilt", "index-error"), np.inf, {"base-tilt": 0.9, "index-error": 0.1}, (2, 72))
    promise = Promise((tie,), {("base-tilt", "index-error"): 0.0, ("index-error", "base-tilt"): 20.0})
    assert promise.certainty == pytest.approx(0.1, abs=0.001)
    assert promise.leaves == ("base-tilt", "index-error")
    assert promise.separates == ()


def test_a_size_that_is_hardly_known_promises_less_than_certainty() -> None:
    """A strength of 4 is known to a quarter: 10 may be 5 as well."""
    sure, weak = (promised([10.0] * 6, {}, d).certainty for d in (np.inf, 4.0))
    assert sure > 0.9999
    assert weak == pytest.approx(0.994, abs=0.001)


@given(st.lists(st.tuples(apart, st.floats(0.01, 1.0)), min_size=1, max_size=4), st.floats(2.0, 30.0))
def test_shapes_that_a_cause_may_have_are_parted_with_their_mean_chance(
    shapes: list[tuple[float, float]], d: float
) -> None:
    tie = TiedCauses.of(NAMES, d, {})
    total = sum(w for _, w in shapes)
    one = tie.as_one([x for x, _ in shapes], [w / total for _, w in shapes])
    wanted = sum(w / total * tie.chance_parted(x) for x, w in shapes)
    assert tie.chance_parted(one) == pytest.approx(wanted, abs=1e-4)
