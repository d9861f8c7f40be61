"""Something is hidden by a bench that knows nothing of the bank; the diagnosis must find it, or stay silent.

`make blind SEED=n` hides new ones. Seeds are used for nothing but these tests: no threshold was set by them.
"""

import os

import numpy as np
import pytest

from station.diagnosis.results.diagnosis_document import document
from station.diagnosis.results.extend import extend_model
from station.model.model_file import Model
from tests.blind.bench import FULL, WHITE, hide
from tests.blind.hidden import ANOTHER_OFFSET, KNOWN, TEMPERATURE_BUMP, UNKNOWN, WRONG_FORM
from tests.blind.inspection import diagnosis_of, searched
from tests.blind.recipes import recipe
from tests.portion import WHOLE, portion

SEED = int(os.environ.get("SEED", "1"))
#: At their usual sizes these are weaker than d = 12 in four units; they are hidden at that strength.
FAINT = {"cubic", "cross-quadratic", "bias-drift"}


@pytest.mark.parametrize("name", portion(KNOWN, 14))
def test_a_known_cause_is_named_sized_paid_for_and_then_silent(name: str) -> None:
    table, truth = hide(recipe(), KNOWN[name], 1000 + SEED, floor=FULL, d=16.0 if name in FAINT else None)
    found = diagnosis_of(recipe(), table)
    assert found.causes, (found.verdict, truth)
    first = found.causes[0].finding
    assert name == first.name or name in first.indistinguishable_from
    assert first.name == name or first.indistinguishable_from
    assert found.causes[0].gain.log_score > 0
    model = extend_model(Model(), found)
    assert [e.effect for e in model.effects][:1] == [first.name]
    if found.verdict == "named":
        assert diagnosis_of(recipe(), table, model).verdict == "none"


@pytest.mark.parametrize("name", portion(WRONG_FORM, 9))
def test_a_cause_of_another_form_is_named_all_the_same(name: str) -> None:
    right, hidden = WRONG_FORM[name]
    table, _ = hide(recipe(), hidden, 2000 + SEED, floor=WHITE, d=16.0)
    found = diagnosis_of(recipe(), table)
    assert found.causes
    first = found.causes[0].finding
    assert right == first.name or right in first.indistinguishable_from


def test_a_cause_that_explains_nothing_is_not_named_for_an_alarm_of_something_else() -> None:
    """Where this alarms at all, "time" is 2.9 nats ahead of a cause worth 0.2: once that was named six times over. The
    right cause, which held-out stops confirm, may be named since ringing is looked for in the samples."""
    right, hidden = WRONG_FORM["ringing"]
    table, _ = hide(recipe(), hidden, 4408029, floor=WHITE, d=8.0)
    found = diagnosis_of(recipe(), table)
    assert all(cause.finding.name == right and cause.gain.accepted for cause in found.causes)
    assert len(found.causes) <= 1
    assert found.causes or found.verdict == ("unknown" if found.search_result.findings else "none")


@pytest.mark.parametrize("name", portion(UNKNOWN, 9))
def test_what_nobody_knows_is_called_unknown_and_says_on_what_it_depends(name: str) -> None:
    words, hidden = UNKNOWN[name]
    table, _ = hide(recipe(), hidden, 3000 + SEED, floor=WHITE, d=24.0)
    found = diagnosis_of(recipe(), table)
    assert found.verdict in ("unknown", "incomplete")
    assert words & set(found.depends_on)


def test_another_offset_in_each_run_is_the_power_ons() -> None:
    table, _ = hide(recipe(), ANOTHER_OFFSET, 3000 + SEED, floor=WHITE, d=24.0)
    assert document(diagnosis_of(recipe(), table))["causes"][0]["effect"] == "turn-on-offset"


def test_a_bump_over_the_temperature_is_told_from_no_offset_of_each_run() -> None:
    table, _ = hide(recipe(), TEMPERATURE_BUMP, 3000 + SEED, floor=WHITE, d=24.0)
    found = diagnosis_of(recipe(), table)
    named = [cause["effect"] for cause in document(found)["causes"]]
    assert set(named[:1]) <= {"offset-temperature", "turn-on-offset"} or found.verdict in ("unknown", "incomplete")


@pytest.mark.parametrize("seed", range(4 if WHOLE else 2))
def test_nothing_hidden_is_nothing_found(seed: int) -> None:
    table, _ = hide(recipe(), None, 4000 + 10 * SEED + seed, floor=FULL if seed % 2 else WHITE)
    found = diagnosis_of(recipe(), table)
    assert found.search_result.statistics[0] < found.search_result.threshold + 1.0
    assert found.verdict == "none" or found.search_result.statistics[0] > found.search_result.threshold


def test_in_one_seat_a_nest_tilt_cannot_be_told_from_turned_packages() -> None:
    table, _ = hide(recipe(1), KNOWN["nest-tilt"], 5000 + SEED)
    shown = document(diagnosis_of(recipe(1), table))["causes"][0]
    assert {"nest-tilt", "package-rotation"} <= {shown["effect"], *shown["indistinguishable_from"]}


def test_two_causes_are_found_one_after_another() -> None:
    def both(w, rng):  # type: ignore[no-untyped-def]
        felt, _ = KNOWN["nest-tilt"](w, rng)
        return felt, KNOWN["offset-temperature"](w, rng)[1]

    table, _ = hide(recipe(), both, 6000 + SEED, floor=FULL)
    assert {f.name for f in searched(recipe(), table).findings} == {"nest-tilt", "offset-temperature"}


def test_jumps_far_above_the_noise_in_several_units_are_jumps_still() -> None:
    """At any one time half of them explain half of the readings, and many disturbed visits more."""
    late = {(0, 0): 8, (1, 2): 18}

    def hidden(w, rng):  # type: ignore[no-untyped-def]
        out = np.zeros_like(w.a)
        for (u, r), stop in late.items():
            out += ((w.unit == u) & (w.run == r) & (w.visit >= stop))[:, None] * 1e-2 * rng.choice([-1, 1], 3)
        return w.a, out

    table, _ = hide(recipe(), hidden, 9100 + SEED, units=2)
    (found,) = searched(recipe(), table).findings
    assert found.name == "step" and found.set_probability > 0.9
    assert found.accepted is not None and found.accepted.hit.sum() == len(late)


def test_jumps_at_another_time_in_each_run_are_one_cause_with_a_time_of_each_run() -> None:
    jumped = {(0, 1): 8, (2, 0): 13, (2, 2): 17}
    at: dict[str, float] = {}

    def hidden(w, rng):  # type: ignore[no-untyped-def]
        out = np.zeros_like(w.a)
        for (u, r), stop in jumped.items():
            late = (w.unit == u) & (w.run == r) & (w.visit >= stop)
            at[f"run:SN{u + 1:04d}/{r}"] = w.t[late].min() - 0.75
            out += late[:, None] * 6e-4 * rng.choice([-1, 1], 3)
        return w.a, out

    table, _ = hide(recipe(), hidden, 9000 + SEED)
    found = diagnosis_of(recipe(), table)
    shown = document(found)["causes"]
    assert [cause["effect"] for cause in shown] == ["step"]
    times = {p["of"]: p["value"] for p in shown[0]["parameters"] if p["name"] == "at"}
    assert times == pytest.approx(at, abs=0.1)
    sized = {p["of"]: abs(p["value"]) for p in shown[0]["parameters"] if p["axis"] == "x"}
    # A mean of seven stops, each known to 71 µg, less that of the others.
    assert sized == pytest.approx(dict.fromkeys(at, 6e-4), abs=1.5e-4)
    assert diagnosis_of(recipe(), table, extend_model(Model(), found)).verdict == "none"


def test_a_cause_whose_covariate_was_not_recorded_is_not_testable() -> None:
    table, _ = hide(recipe(), None, 7000 + SEED, without=("temperature_degC", "motor", "since_clamp_s"))
    missing = {"offset-temperature", "gain-temperature", "temperature-rate", "vibration-rectification", "clamp-creep"}
    assert missing <= set(diagnosis_of(recipe(), table).not_testable)


def test_sizes_lie_within_their_intervals() -> None:
    inside = []
    for seed in range(3):
        rng_truth: list[np.ndarray] = []

        def hidden(w, rng, stored=rng_truth):  # type: ignore[no-untyped-def]
            c = 3e-4 * rng.standard_normal((int(w.unit.max()) + 1, 3))
            stored[:] = [c]
            return w.a, c[w.unit] * w.a**2

        table, _ = hide(recipe(), hidden, 8000 + 10 * SEED + seed)
        estimate = diagnosis_of(recipe(), table).causes[0].estimate
        assert estimate is not None
        inside += [np.abs(estimate.value - rng_truth[0]) < 1.96 * estimate.std]
    # 36 intervals of 95 %: fewer than 30 right happen once in ten thousand campaigns.
    assert np.concatenate(inside).sum() >= 30
