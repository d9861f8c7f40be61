"""A dwell as evidence: every way in which it can be none, from frames made to be so; and what counts as rest."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from station.adapters.dbc import read_layouts
from station.config.products import load_product
from station.config.recipes import load_recipe
from station.config.search_path import shipped_folder
from station.domain.can import encode
from station.domain.can.decode import decode_samples
from station.domain.can.sensor_layout import SensorLayout, resolve
from station.domain.capture.rest_detection import angle_deg, at_rest, expected_noise, face, has_direction
from station.domain.capture.visit import Visit
from station.domain.capture.visit_check import STATION_CHECKS, check, statistics
from station.domain.core.types import Floats, Frames
from station.domain.product.emergency_codes import emergency
from station.domain.recipe.recipe import Recipe
from tests.conftest import SEED

NODE = 17
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def layout() -> SensorLayout:
    product = load_product("accelerometer", None)
    return resolve(product.frames, read_layouts(Path(shipped_folder(), "dbc", product.frames.dbc)))


@pytest.fixture(scope="module")
def recipe() -> Recipe:
    return load_recipe("six-point")


def readings(n: int = 100, noise: float = 7e-4, mean: Floats = UP) -> Floats:
    return mean + noise * np.random.default_rng(SEED).standard_normal((n, 3))


def frames(layout: SensorLayout, xyz: Floats, rate_hz: float = 100.0) -> Frames:
    time_ns = np.round(np.arange(len(xyz)) * 1e9 / rate_hz).astype(np.int64)
    return encode.sample_frames(layout, NODE, time_ns, xyz)


def visit(layout: SensorLayout, came: Frames, **change: object) -> Visit:
    whole = Visit(0, 0, "z-up", "home", 0, 0, 10**9, decode_samples(came, layout, NODE), temperature_degC=24.0)
    return replace(whole, **change)  # type: ignore[arg-type]


def checks(layout: SensorLayout, recipe: Recipe, xyz: Floats, true: Floats = UP, **change: object) -> set[str]:
    found = check(visit(layout, frames(layout, xyz), **change), true, recipe, layout)
    assert all(r.sentence.isprintable() for r in found)
    return {r.check for r in found}


def test_a_good_dwell_has_nothing_against_it(layout: SensorLayout, recipe: Recipe) -> None:
    assert checks(layout, recipe, readings()) == set()


@pytest.mark.parametrize(
    ("wrong", "change"),
    [
        ("kernel-drops", {"drops": 3}),
        ("temperature", {"temperature_degC": 45.0}),
        ("temperature", {"temperature_degC": -3.0}),
        ("emergency", {"emergencies": (emergency(0x4210, 1),)}),
        ("too-few", {"to_ns": 2 * 10**9}),
        ("wrong-face", {"true": np.array([1.0, 0, 0])}),
        ("wrong-face", {"true": -UP}),
    ],
)
def test_what_happened_around_it(layout: SensorLayout, recipe: Recipe, wrong: str, change: dict[str, Any]) -> None:
    assert checks(layout, recipe, readings(), **change) == {wrong}


@pytest.mark.parametrize(
    ("rate_hz", "late_ms", "wrong"),
    [(100, 150, set()), (80, 0, {"rate"}), (80, 150, {"too-few"}), (125, 0, {"rate"}), (125, 150, {"rate"})],
)
def test_frames_that_were_held_back_on_their_way_tell_less_of_the_rate(
    layout: SensorLayout, recipe: Recipe, rate_hz: int, late_ms: int, wrong: set[str]
) -> None:
    """An adapter, or a busy machine, hands over the first frames of the dwell together."""
    came = frames(layout, readings(rate_hz), rate_hz)
    held = Frames(np.maximum(came.time_ns, late_ms * 10**6), came.can_id, came.length, came.data)
    assert {r.check for r in check(visit(layout, held), UP, recipe, layout)} == wrong


def test_no_frames_at_all_is_silence(layout: SensorLayout, recipe: Recipe) -> None:
    found = check(visit(layout, Frames.empty()), UP, recipe, layout)
    assert [r.check for r in found] == ["silent"]
    assert found[0].check in STATION_CHECKS
    assert statistics(visit(layout, Frames.empty()))["mean"] is None


def test_axes_that_cannot_be(layout: SensorLayout, recipe: Recipe) -> None:
    stuck = readings()
    stuck[:, 1] = 0.03
    assert checks(layout, recipe, stuck) == {"stuck"}
    clipped = readings(mean=np.array([0, 0, 2.2]))
    assert checks(layout, recipe, clipped) == {"clipped"}
    loud = readings(noise=0.02)
    assert checks(layout, recipe, loud) == {"noise"}


def test_a_coarse_sensor_may_stand_still(layout: SensorLayout, recipe: Recipe) -> None:
    """Where frames are as coarse as its steps, and where they are finer and the recipe says how coarse it is."""
    still = np.tile([0.0125, 0.0375, 1.0], (100, 1))
    assert "stuck" in checks(layout, recipe, still)
    coarse = replace(layout, sample=replace(layout.sample, signals=tuple(
        replace(s, scale=0.0125) if s.name in "XYZ" else s for s in layout.sample.signals
    )))  # fmt: skip
    assert not check(visit(coarse, frames(coarse, still)), UP, recipe, coarse)
    sheet = recipe.device.model_copy(update={"lsb": 0.0125})
    assert not checks(layout, recipe.model_copy(update={"device": sheet}), still)


def test_a_part_that_is_touched_during_the_dwell(layout: SensorLayout, recipe: Recipe) -> None:
    bumped = readings()
    bumped[60:, 0] += 0.01
    assert checks(layout, recipe, bumped) == {"not-still"}
    warming = readings() + np.linspace(0, 0.0004, 100)[:, None]
    assert checks(layout, recipe, warming) == set(), "a slow drift below what matters is the budget's business"


def test_the_transport(layout: SensorLayout, recipe: Recipe) -> None:
    whole = frames(layout, readings())
    lost = whole[np.delete(np.arange(100), [40, 41])]
    assert {r.check for r in check(visit(layout, lost), UP, recipe, layout)} == {"frames"}
    again = whole[np.insert(np.arange(100), 40, 40)]
    assert {r.check for r in check(visit(layout, again), UP, recipe, layout)} == {"frames"}
    data = whole.data.copy()
    data[7, 5] ^= 0x10
    bad = Frames(whole.time_ns, whole.can_id, whole.length, data)
    (found,) = check(visit(layout, bad), UP, recipe, layout)
    assert "1 frame with a wrong CRC" in found.sentence


@pytest.mark.parametrize(("rate_hz", "printed"), [(100.5, False), (110.0, True), (91.0, True)])
def test_a_clock_that_is_off(layout: SensorLayout, recipe: Recipe, rate_hz: float, printed: bool) -> None:
    came = frames(layout, readings(round(rate_hz)), rate_hz)
    found = {r.check for r in check(visit(layout, came), UP, recipe, layout)}
    assert found == ({"rate"} if printed else set())


def test_statistics_are_of_the_usable_readings(layout: SensorLayout) -> None:
    xyz = readings()
    shown = statistics(visit(layout, frames(layout, xyz)))
    np.testing.assert_allclose(np.asarray(shown["mean"]), xyz.mean(axis=0), atol=6.25e-5)
    assert (shown["count"], shown["lost"], shown["crc_errors"], shown["kernel_drops"]) == (100, 0, 0, 0)


@pytest.mark.parametrize("seed", range(20))
def test_rest_is_seen_and_so_is_movement(seed: int) -> None:
    rng = np.random.default_rng(seed)
    noise = 7e-4 * rng.standard_normal((40, 3))
    assert at_rest(UP + noise, 7e-4, 6e-5)
    assert not at_rest(UP + noise + np.linspace(0, 0.005, 40)[:, None], 7e-4, 6e-5)
    assert not at_rest(UP + noise + 0.1 * np.sin(np.arange(40))[:, None], 7e-4, 6e-5)
    assert not at_rest((UP + noise)[:7], 7e-4, 6e-5), "too few to tell"


def test_directions() -> None:
    assert face(np.array([0.1, -0.9, 0.3])) == "-y"
    assert angle_deg(np.array([1.0, 1, 0]), np.array([2.0, 0, 0])) == pytest.approx(45)
    assert angle_deg(np.zeros(3), UP) == 180


def test_which_stimulus_points_somewhere(recipe: Recipe) -> None:
    assert has_direction(UP, recipe)
    assert not has_direction(np.full(3, np.nan), recipe)
    gyroscope = load_recipe("gyroscope-n-point")
    assert has_direction(np.array([0.0, 0, 90]), gyroscope)
    assert not has_direction(np.array([0.0, 0, 0.004]), gyroscope), "the Earth's turning"
    assert not has_direction(np.array([0.0, 0, 48.0]), load_recipe("magnetometer-n-point")), "hard iron may be larger"


def test_expected_noise_is_the_sheets_white_noise_and_rounding(recipe: Recipe) -> None:
    assert expected_noise(recipe) == pytest.approx(np.hypot(1e-4 * np.sqrt(50), 6.25e-5 / np.sqrt(12)))


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_a_second_sender_on_the_units_identifiers_is_the_stations_fault(
    layout: SensorLayout, recipe: Recipe, share: float
) -> None:
    """Somebody sends good frames with the unit's identifier and a counter of his own in between."""
    own, count = frames(layout, readings(1000), 1000.0), round(1000 * share)
    time_ns = np.round(np.linspace(0, 1, count, endpoint=False) * 1e9).astype(np.int64) + 400_000
    his = encode.sample_frames(layout, NODE, time_ns, readings(count), first_count=5)
    both = Frames.join([own, his])
    mixed = both[np.argsort(both.time_ns, kind="stable")]
    fast = recipe.model_copy(update={"device": recipe.device.model_copy(update={"rate_hz": 1000.0})})
    found = {r.check for r in check(visit(layout, mixed), UP, fast, layout)}
    assert "foreign-sender" in found & STATION_CHECKS
    assert "foreign-sender" not in {r.check for r in check(visit(layout, own), UP, fast, layout)}


def test_lost_and_repeated_frames_are_no_second_sender(layout: SensorLayout, recipe: Recipe) -> None:
    own = frames(layout, readings(100))
    lost, doubled = own[np.arange(100) % 7 != 3], own[np.sort(np.r_[0:100, 20:40])]
    for came in (lost, doubled):
        found = {r.check for r in check(visit(layout, came), UP, recipe, layout)}
        assert "frames" in found
        assert "foreign-sender" not in found
