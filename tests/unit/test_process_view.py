"""The charts of one value: limits, rules by shape and by text, boxes by nest, the change of a mean against scipy's."""

import re

import numpy as np
import pytest
import scipy

from station.config.recipes import load_recipe
from station.config.search_path import shipped_folder
from station.domain.line_quality.comparison import compare
from station.domain.recipe.blocks import Limits
from station.domain.recipe.recipe import Recipe
from station.reporting.drawing.tables import Count, pareto
from station.reporting.line.process_view import Chosen, view_process
from station.reporting.line.statistics import AttemptValues, LineStatistics
from station.reporting.line.value_series import Control, ValueSeries
from station.reporting.words import words_of
from tests.conftest import SEED

NESTS = ("bench/A", "bench/B", "bench/C")


def line_of(values: list[float], recipe: Recipe) -> LineStatistics:
    limited = recipe.model_copy(update={"limits": Limits(gain=0.05)})
    attempts = tuple(
        AttemptValues(
            f"SN{i:04d}", NESTS[i % 3], i * 10**9, "PASS" if abs(v - 1) < 0.05 else "FAIL", {"gain y": v}, {}, {}
        )
        for i, v in enumerate(values, 1)
    )
    return LineStatistics(limited, attempts, {})


@pytest.fixture(scope="module")
def six_point() -> Recipe:
    return load_recipe(shipped_folder() / "recipes" / "six-point.yaml")


@pytest.fixture
def quiet() -> list[float]:
    """Thirty gains without a pattern: they alternate in steps of a random size."""
    sizes = np.random.default_rng(SEED).uniform(0.0005, 0.0015, 30)
    return [1 + s * (1, 1, -1, -1)[i % 4] for i, s in enumerate(sizes)]


def drawn(values: list[float], recipe: Recipe, chosen: Chosen = Chosen()) -> str:  # noqa: B008 - frozen
    return str(view_process(line_of(values, recipe), "gain y", chosen, str, words_of("en")).chart)


def test_a_unit_outside_its_limits_does_not_widen_the_control_limits(quiet: list[float], six_point: Recipe) -> None:
    alone, joined = (Control.of(ValueSeries.of(line_of(v, six_point), "gain y")) for v in (quiet, [*quiet, 0.9]))
    assert alone is not None
    assert joined is not None
    assert (joined.centre, joined.sigma) == pytest.approx((alone.centre, alone.sigma))


def test_marks_tell_the_rule_by_shape_and_by_text(quiet: list[float], six_point: Recipe) -> None:
    plain = drawn(quiet, six_point)
    assert "USL 1.05" in plain
    assert "LSL 0.95" in plain
    assert "target 1" in plain
    assert "polygon" not in plain, "every unit is in control: circles only"
    spike = drawn([*quiet, 1.02], six_point)
    assert spike.count("beyond 3σ") >= 2, "beside the mark and in the legend"
    assert "<polygon" in spike
    low = drawn([*quiet, 0.9], six_point)
    assert "SN0031" in low
    assert "outside the limits" in low
    shifted = drawn([*quiet, *(v + 0.002 for v in quiet[:10])], six_point)
    assert "nine on a side" in shifted


def test_the_choice_is_what_is_listed(quiet: list[float], six_point: Recipe) -> None:
    seen = view_process(line_of(quiet, six_point), "gain y", Chosen(5, 9), str, words_of("en"))
    assert [number for number, _ in seen.selected] == [5, 6, 7, 8, 9]
    assert 'class="picked"' in str(seen.chart)
    assert len(view_process(line_of(quiet, six_point), "gain y", Chosen(last=999), str, words_of("en")).selected) == 30
    assert re.findall(r">([ABC])</text>", str(seen.boxes)) == ["A", "B", "C"]
    assert view_process(line_of(quiet[:1], six_point), "gain y", Chosen(), str, words_of("en")).chart is None


def test_the_change_of_a_mean_is_welchs() -> None:
    rng = np.random.default_rng(SEED)
    before, after = rng.normal(0.99, 0.003, 11), rng.normal(0.9975, 0.005, 13)
    found = compare(before, after)
    assert found is not None
    peer = scipy.stats.ttest_ind(after, before, equal_var=False).confidence_interval(0.95)
    assert found.difference - found.half_width == pytest.approx(peer.low)
    assert found.difference + found.half_width == pytest.approx(peer.high)
    assert compare(before[:1], after) is None


def test_the_bars_of_reasons_lead_to_their_attempts() -> None:
    shown = str(pareto("Why", [Count("Noise", 1), Count("Gain <y>", 3, "/audit?check=gain&nest=B")], "running sum"))
    assert shown.index("Gain &lt;y&gt;") < shown.index("Noise")
    assert 'href="/audit?check=gain&amp;nest=B"' in shown
    assert "75 %" in shown
    assert "100 %" in shown
    assert 'role="group"' in shown
