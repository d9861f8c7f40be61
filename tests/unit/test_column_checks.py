"""Optional columns that do not say what their names say."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from station.config.recipes import load_recipe
from station.diagnosis.data import column_checks, preflight
from station.domain.core.types import Floats, Labels, SampleTable
from station.errors import SamplesError
from tests.blind.bench import hide

RECIPE = load_recipe("tilt-24")
BITS = RECIPE.device.counter_bits
Counts = Callable[[Floats], Floats]


def table() -> SampleTable:
    """One run of two units, with a counter that runs on while moving."""
    made, _ = hide(RECIPE, None, 1, units=2)
    count = np.floor(made.time_s * RECIPE.device.rate_hz + 0.25)
    return replace(made, values={**made.values, "counter": count % 2**BITS})


def counted(by: Counts) -> tuple[SampleTable, tuple[str, ...]]:
    """The table with other counts, and what is said of them."""
    made = table()
    count = np.floor(made.time_s * RECIPE.device.rate_hz + 0.25)
    used, said = column_checks.without_misnamed(RECIPE, replace(made, values={**made.values, "counter": by(count)}))
    return used, tuple(one.id for one in said)


@pytest.mark.parametrize(
    "by",
    [
        pytest.param(np.zeros_like, id="stands still"),
        pytest.param(lambda n: 2 * n % 2**BITS, id="goes by two"),
        pytest.param(lambda n: n // 2 % 2**BITS, id="counts pairs"),
        pytest.param(lambda n: -n % 2**BITS, id="goes down"),
        pytest.param(lambda n: np.random.default_rng(1).integers(0, 2**BITS, len(n)).astype(float), id="is random"),
    ],
)
def test_a_counter_that_counts_no_frames_is_not_used(by: Counts) -> None:
    used, said = counted(by)
    assert said == ("counter-counts-nothing",)
    assert "counter" not in used.values


def test_a_counter_of_other_bits_is_said_and_not_used() -> None:
    used, said = counted(lambda n: n % 16)
    assert said == ("counter-wraps-early",)
    assert "counter" not in used.values


@pytest.mark.parametrize(
    "by",
    [
        pytest.param(lambda n: n % 2**BITS, id="as stated"),
        pytest.param(lambda n: n, id="never wraps"),
        pytest.param(lambda n: n % 2 ** (BITS + 4), id="more bits than are used"),
    ],
)
def test_a_counter_that_counts_is_used(by: Counts) -> None:
    used, said = counted(by)
    assert (said, "counter" in used.values) == ((), True)


@pytest.mark.parametrize("lost", [0.3, 0.7])
def test_a_counter_of_a_bus_that_loses_frames_is_used(lost: float, rng: np.random.Generator) -> None:
    made = table()
    used, said = column_checks.without_misnamed(RECIPE, made[rng.random(len(made)) > lost])
    assert (said, "counter" in used.values) == ((), True)


def test_a_counter_of_a_bus_that_repeats_each_frame_is_used() -> None:
    made = table()
    used, said = column_checks.without_misnamed(RECIPE, made[np.repeat(np.arange(len(made)), 3)])
    assert (said, "counter" in used.values) == ((), True)


def test_labels_that_change_within_a_visit_are_not_used() -> None:
    made = table()
    names = tuple(f"A{i}" for i in range(len(made)))
    one = Labels(("lot",), np.zeros(len(made), np.int32))
    labels = {"nest": Labels(names, np.arange(len(made), dtype=np.int32)), "lot": one}
    used, said = column_checks.without_misnamed(RECIPE, replace(made, labels=labels))
    assert [message.parameters["column"] for message in said] == ["nest"]
    assert list(used.labels) == ["lot"]


def test_labels_that_nearly_each_visit_has_of_its_own_are_not_used() -> None:
    made = table()
    visit = np.cumsum(np.diff(made.visit, prepend=-1) != 0).astype(np.int32) - 1
    each, nests = (
        Labels(tuple(f"A{i}" for i in range(k)), code)
        for k, code in ((int(visit.max()) + 1, visit), (2, (made.unit.code % 2).astype(np.int32)))
    )
    used, said = column_checks.without_misnamed(RECIPE, replace(made, labels={"lot": each, "nest": nests}))
    assert [message.id for message in said] == ["label-of-no-group"]
    assert list(used.labels) == ["nest"]


def test_two_seatings_in_a_visit_are_refused() -> None:
    made = table()
    half = Labels(("home", "turned"), (np.arange(len(made)) % 2).astype(np.int32))
    with pytest.raises(SamplesError, match="A visit has one seating"):
        preflight.inspect(RECIPE, replace(made, labels={**made.labels, "seating": half}))


def test_a_table_joined_with_a_copy_of_itself_is_taken_once() -> None:
    made = table()
    found, used = preflight.inspect(RECIPE, made[np.r_[np.arange(len(made)), np.arange(len(made))]])
    assert [one.id for one in found.remarks] == ["samples-written-again"]
    assert np.array_equal(used.reading, made.reading)
