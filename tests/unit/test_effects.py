"""Known answers, worked out by hand, for each family of causes: one visit or a few, one cause, one number."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from station import plugins
from station.domain.core.types import Floats, Labels, SampleTable
from station.domain.recipe.recipe import Recipe
from station.errors import UsageError
from station.model.effect import Effect, Parameter, random_stream, stimulus_strength
from station.model.forward import ActiveEffect, BaseResponse, convert_output, forward
from station.model.scene import Scene, scene_of_table
from station.model.simulate import parse_effect

FACES = {"z-up": "+z", "x-up": "+x", "y-up": "+y", "z-down": "-z", "x-down": "-x", "y-down": "-y"}


def recipe(**changes: Any) -> Recipe:
    return Recipe.model_validate(
        {
            "schema": "station.recipe/1",
            "name": "faces",
            "version": 1,
            "sensor": "accelerometer",
            "unit": "g",
            "reference": {"source": "gravity", "magnitude": 1.0},
            "positions": [{"name": name, "up": up} for name, up in FACES.items()],
            "seatings": {"turned": {"axis": [0, 0, 1], "angle_deg": 180}},
            "settle": {"time_s": 0.0},
            **changes,
        }
    )


def scene(
    positions: list[str],
    *,
    seating: str = "home",
    run: list[int] | None = None,
    values: Mapping[str, Floats] = {},
    **changes: Any,
) -> Scene:
    """One sample a stop, ten seconds apart, of one unit U in nest N1."""
    n = len(positions)
    runs = np.array(run or [0] * n, np.int32)
    visit = np.concatenate([np.arange(np.sum(runs == r)) for r in np.unique(runs)]).astype(np.int32)
    table = SampleTable(
        Labels.of(["U"] * n),
        runs,
        visit,
        Labels.of(positions),
        10.0 * visit.astype(float),
        np.zeros((n, 3)),
        {"seating": Labels.of([seating] * n), "nest": Labels.of(["N1"] * n)},
        dict(values),
    )
    return scene_of_table(recipe(**changes), table)


def reads(
    effect: str, coefficients: Any, at: Scene, of: str = "", base: BaseResponse | None = None, **form: float
) -> Floats:
    """Readings (n, 3) with one cause on; the same coefficients for all groups, or one row each."""
    kind: type[Effect] = plugins.load("station.model.effects", effect)
    cause = kind(kind.parameter.typical, **form)
    of = of or cause.of[0]
    groups = len(at.group(of)[1])
    c = np.broadcast_to(np.atleast_2d(np.array(coefficients, float)), (groups, len(cause.axes)))
    return forward(at, base or BaseResponse.ideal(1), {effect: ActiveEffect(cause, c, of)})


def test_at_rest_an_axis_that_points_up_reads_plus_one() -> None:
    readings = forward(scene(list(FACES)), BaseResponse.ideal(1))
    np.testing.assert_allclose(
        readings, [[0, 0, 1], [1, 0, 0], [0, 1, 0], [0, 0, -1], [-1, 0, 0], [0, -1, 0]], atol=1e-15
    )


def test_measured_is_matrix_times_true_plus_offset() -> None:
    base = BaseResponse(np.array([[0.1, 0.2, 0.3]]), np.array([[[1.0, 0.1, 0.0], [0.0, 1.0, 0.2], [0.3, 0.0, 1.0]]]))
    np.testing.assert_allclose(forward(scene(["z-up", "y-up"]), base), [[0.1, 0.4, 1.3], [0.2, 1.2, 0.3]], atol=1e-15)


# --- pose: R = exp(station) · nest · exp(nest) · seat · exp(device), right-handed, turns the part -------------------


def test_nest_tilt_turns_the_part_in_the_nest() -> None:
    """Turned by θ about the nest's x, the part's y axis leans up: it reads sin θ at z-up. Turned by π: −sin θ."""
    s, c = np.sin(0.01), np.cos(0.01)
    np.testing.assert_allclose(reads("nest-tilt", [0.01, 0, 0], scene(["z-up"])), [[0, s, c]], atol=1e-15)
    turned = scene(["z-up"], seating="turned")
    np.testing.assert_allclose(reads("nest-tilt", [0.01, 0, 0], turned), [[0, -s, c]], atol=1e-15)


def test_package_rotation_turns_with_the_device() -> None:
    """In the device's own frame the seating does not matter: always + sin θ."""
    s, c = np.sin(0.01), np.cos(0.01)
    for seating in ("home", "turned"):
        at = scene(["z-up"], seating=seating)
        np.testing.assert_allclose(reads("package-rotation", [0.01, 0, 0], at), [[0, s, c]], atol=1e-15)


def test_base_tilt_is_in_the_station_frame() -> None:
    """The base leans by θ about the station's x: at z-up y reads sin θ, at x-up (nest turned −90° about y) still y."""
    s, c = np.sin(0.01), np.cos(0.01)
    got = reads("base-tilt", [0.01, 0], scene(["z-up", "x-up"]))
    np.testing.assert_allclose(got, [[0, s, c], [c, s, 0]], atol=1e-15)


def test_a_rig_turned_on_its_floor_leans_the_other_way_there() -> None:
    """Half a turn about the vertical: what leaned towards −y of the rig leans towards +y; errors of positions stay."""
    at = scene(["z-up", "z-up"], run=[0, 1], runs=[{}, {"base_turn_deg": 180}])
    s, c = np.sin(0.01), np.cos(0.01)
    np.testing.assert_allclose(reads("base-tilt", [0.01, 0], at), [[0, s, c], [0, -s, c]], atol=1e-15)
    np.testing.assert_allclose(reads("index-error", [0.01, 0, 0], at), [[0, s, c], [0, s, c]], atol=1e-15)


def test_tilt_is_exact_not_linear() -> None:
    """Half a turn about x puts the part on its head."""
    np.testing.assert_allclose(reads("nest-tilt", [np.pi, 0, 0], scene(["z-up"])), [[0, 0, -1]], atol=1e-15)


def test_index_error_belongs_to_the_position() -> None:
    """Groups are positions in alphabetical order: x-up, z-up; only z-up is off."""
    got = reads("index-error", [[0, 0, 0], [0, 0.01, 0]], scene(["z-up", "x-up", "z-up"]))
    tilted = [-np.sin(0.01), 0, np.cos(0.01)]
    np.testing.assert_allclose(got, [tilted, [1, 0, 0], tilted], atol=1e-15)


@pytest.mark.parametrize("name", ["repeatability", "disturbed-visit"])
def test_each_visit_has_its_own_angle(name: str) -> None:
    got = reads(name, [[0, 0.01, 0], [0, 0, 0], [0, -0.02, 0]], scene(["z-up", "z-up", "z-up"]))
    np.testing.assert_allclose(got[:, 0], [-np.sin(0.01), 0, np.sin(0.02)], atol=1e-15)


def test_two_tilts_of_one_frame_are_one_rotation_by_their_sum() -> None:
    at = scene(["z-up"])
    tilt: type[Effect] = plugins.load("station.model.effects", "nest-tilt")
    index: type[Effect] = plugins.load("station.model.effects", "index-error")
    one, two = np.array([[0.1, 0.2, 0.0]]), np.array([[0.0, -0.2, 0.3]])
    both = forward(
        at,
        BaseResponse.ideal(1),
        {"a": ActiveEffect(tilt(1.0), one, "nest"), "b": ActiveEffect(index(1.0), two, "position")},
    )
    np.testing.assert_allclose(both, reads("nest-tilt", one + two, at), atol=1e-15)


# --- what the sensor feels and reads -------------------------------------------------------------------------------


def test_local_gravity_goes_through_the_gain() -> None:
    base = BaseResponse(np.array([[0.5, 0.0, 0.0]]), 2 * np.eye(3)[None])
    np.testing.assert_allclose(reads("local-gravity", 0.001, scene(["x-up"]), base=base), [[2.502, 0, 0]], atol=1e-15)


def test_sensor_effects_are_added_after_the_gain() -> None:
    """c · a² of the true vector, whatever the unit's gain."""
    base = BaseResponse(np.zeros((1, 3)), 2 * np.eye(3)[None])
    got = reads("quadratic", [0.01, 0.02, 0.03], scene(["x-up", "y-down"]), base=base)
    np.testing.assert_allclose(got, [[2.01, 0, 0], [0, -1.98, 0]], atol=1e-15)


def test_cross_axis_is_symmetric() -> None:
    """At x-up, y gains s_xy and z gains s_xz; at y-up, x gains s_xy and z gains s_yz."""
    got = reads("cross-axis", [0.01, 0.02, 0.03], scene(["x-up", "y-up", "z-down"]))
    np.testing.assert_allclose(got, [[1, 0.01, 0.02], [0.01, 1, 0.03], [-0.02, -0.03, -1]], atol=1e-15)


def test_cubic_and_asymmetry_at_plus_and_minus() -> None:
    up_down = scene(["x-up", "x-down"])
    np.testing.assert_allclose(reads("cubic", [0.01] * 3, up_down)[:, 0], [1.01, -1.01], atol=1e-15)
    np.testing.assert_allclose(reads("asymmetry", [0.01] * 3, up_down)[:, 0], [1.01, -0.99], atol=1e-15)


def test_cross_quadratic_needs_two_axes_at_once() -> None:
    """Nothing at a face; half way between two faces each reads c · sin 45° · cos 45° more."""
    face = scene(["x-up"])
    np.testing.assert_allclose(
        reads("cross-quadratic", [1.0] * 6, face), forward(face, BaseResponse.ideal(1)), atol=1e-15, rtol=0
    )
    tilted = {"name": "tilted", "rotate": [{"axis": [1, 0, 0], "angle_deg": 45}]}
    zero = np.zeros(1, np.int32)
    table = SampleTable(Labels.of(["U"]), zero, zero, Labels.of(["tilted"]), np.zeros(1), np.zeros((1, 3)))
    between = scene_of_table(recipe(positions=[tilted]), table)
    got = reads("cross-quadratic", [0, 0, 0, 0.2, 0, 0], between) - forward(between, BaseResponse.ideal(1))
    np.testing.assert_allclose(got, [[0, 0.1, 0]], atol=1e-15)


def test_hysteresis_remembers_the_stop_before_but_not_across_runs() -> None:
    """previous − present: z-up → x-up is (−1, 0, +1); the first stop of each run has no previous one."""
    got = reads("hysteresis", [0.1, 0.2, 0.3], scene(["z-up", "x-up", "y-up"], run=[0, 0, 1]))
    np.testing.assert_allclose(got, [[0.0, 0, 1], [0.9, 0, 0.3], [0.0, 1, 0]], atol=1e-15)


def test_hysteresis_takes_the_true_previous_vector() -> None:
    """With the nest tilted half a turn about x, z-up is really −z: the step to x-up is (−1, 0, −1)."""
    at = scene(["z-up", "x-up"])
    effects = {name: plugins.load("station.model.effects", name) for name in ("hysteresis", "nest-tilt")}
    active = {
        "h": ActiveEffect(effects["hysteresis"](1.0), np.full((1, 3), 0.1), "unit"),
        "n": ActiveEffect(effects["nest-tilt"](1.0), np.array([[np.pi, 0, 0]]), "nest"),
    }
    np.testing.assert_allclose(forward(at, BaseResponse.ideal(1), active)[1], [0.9, 0, -0.1], atol=1e-15)


@pytest.mark.parametrize("name", ["settling", "filter-lag"])
def test_what_is_left_of_a_move_dies_away(name: str) -> None:
    """c · (previous − present) · e^(−t/τ), t from the first sample plus settle.time_s."""
    n = 3
    table = SampleTable(
        Labels.of(["U"] * (n + 1)),
        np.zeros(n + 1, np.int32),
        np.array([0, 1, 1, 1], np.int32),
        Labels.of(["z-up"] + ["x-up"] * n),
        np.array([0.0, 5.0, 5.2, 5.4]),
        np.zeros((n + 1, 3)),
    )
    at = scene_of_table(recipe(settle={"time_s": 0.1}), table)
    assert at.since_arrival_s is not None
    np.testing.assert_allclose(at.since_arrival_s, [0.1, 0.1, 0.3, 0.5])
    got = reads(name, [0.5] * 3, at, time_constant_s=0.2)
    left = 0.5 * np.exp(-np.array([0.1, 0.3, 0.5]) / 0.2)
    np.testing.assert_allclose(got[1:], np.stack([1 - left, 0 * left, left], 1), atol=1e-15)


def test_a_filter_that_is_off_lags_no_more_and_the_rig_still_swings() -> None:
    at = scene(["z-up", "x-up"] * 2, run=[0, 0, 1, 1], runs=[{}, {"filter": "off"}])
    lag, swing = (reads(name, [0.5] * 3, at, time_constant_s=1.0) for name in ("filter-lag", "settling"))
    np.testing.assert_allclose(lag, [[0.0, 0, 1], [0.5, 0, 0.5], [0.0, 0, 1], [1.0, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(swing[2:], lag[:2], atol=1e-15)


def test_settling_may_ring() -> None:
    """At 2.5 Hz and 0.2 s the swing is half a period on: the sign is turned."""
    at = scene(["z-up", "x-up"], values={})
    late = Scene(at.recipe, at.visits, at.visit, at.time_s, np.array([0.0, 0.2]))
    got = reads("settling", [0.5] * 3, late, time_constant_s=0.2, frequency_hz=2.5)
    np.testing.assert_allclose(got[1], [1 + 0.5 / np.e, 0, -0.5 / np.e], atol=1e-15)


def test_temperature_acts_from_25_degC() -> None:
    warm = scene(["x-up", "x-down"], values={"temperature_degC": np.array([35.0, 25.0])})
    np.testing.assert_allclose(
        reads("offset-temperature", [0.01] * 3, warm), [[1.1, 0.1, 0.1], [-1.0, 0, 0]], atol=1e-15
    )
    np.testing.assert_allclose(reads("gain-temperature", [0.01] * 3, warm), [[1.1, 0, 0], [-1.0, 0, 0]], atol=1e-15)


def test_temperature_rate_of_a_ramp() -> None:
    """One degree in every ten seconds: 0.1 degC/s at each stop."""
    ramp = scene(["x-up"] * 5, values={"temperature_degC": 20.0 + np.arange(5, dtype=float)})
    np.testing.assert_allclose(reads("temperature-rate", [0.5] * 3, ramp)[:, 1], np.full(5, 0.05), atol=1e-12)


def test_clocks_that_causes_run_on() -> None:
    values = {"since_power_s": np.array([40.0, 80.0]), "since_clamp_s": np.array([10.0, 30.0])}
    at = scene(["z-up", "z-up"], values=values)
    got = reads("warm-up", [1.0] * 3, at, time_constant_s=40.0)[:, 0]
    np.testing.assert_allclose(got, np.exp([-1, -2]), atol=1e-15)
    got = reads("clamp-creep", [1.0] * 3, at, time_constant_s=10.0)[:, 0]
    np.testing.assert_allclose(got, np.log([2, 4]), atol=1e-15)
    np.testing.assert_allclose(reads("bias-drift", [0.002] * 3, at)[:, 0], [0, 0.02], atol=1e-15)


def test_bias_walk_sums_up_within_a_run() -> None:
    steps = [[1, 0, 0], [2, 0, 0], [4, 0, 0], [8, 0, 0]]
    got = reads("bias-walk", steps, scene(["z-up"] * 4, run=[0, 0, 1, 1]))
    np.testing.assert_allclose(got[:, 0], [1, 3, 4, 12], atol=1e-15)


def test_equal_coefficients_of_all_groups_are_those_of_each() -> None:
    at = scene(["z-up", "x-up"] * 3, run=[0, 0, 1, 1, 2, 2])
    kinds: list[type[Effect]] = list(plugins.load_all("station.model.effects").values())
    for effect in (kind.example() for kind in kinds):
        for of in (level for level in effect.of if level in ("unit", "run", "visit", "common", "position", "nest")):
            one = np.arange(1.0, 1.0 + len(effect.axes))
            each = np.tile(one, (len(at.group(of)[1]), 1))
            found = effect.gather_alike(at, one, of)
            np.testing.assert_array_equal(found, effect.gather(at, each, of)[at.visit])


def test_motors_rectify_with_the_square_of_their_drive() -> None:
    at = scene(["z-up"] * 3, values={"motor": np.array([0.0, 0.5, 1.0])})
    got = reads("vibration-rectification", [0.4] * 3, at)[:, 0]
    np.testing.assert_allclose(got, [0, 0.1, 0.4], atol=1e-15)


def test_motor_tone_aliases_at_the_sample_rate() -> None:
    """Sampled at 10 Hz, 12.5 Hz cannot be told from 2.5 Hz: 0, 1, 0, −1."""
    n = 4
    values = {"motor": np.ones(n), "started_s": np.full(n, 7.0)}
    zero = np.zeros(n, np.int32)
    table = SampleTable(
        Labels.of(["U"] * n),
        zero,
        zero,
        Labels.of(["z-up"] * n),
        0.1 * np.arange(n, dtype=float),
        np.zeros((n, 3)),
        {},
        values,
    )
    at = scene_of_table(recipe(), table)
    tones = [
        reads("motor-tone", [1.0] * 3, at, frequency_hz=f, phase_rad=-2 * np.pi * f * 7.0)[:, 0] for f in (2.5, 12.5)
    ]
    np.testing.assert_allclose(tones[0], [0, 1, 0, -1], atol=1e-12)
    np.testing.assert_allclose(tones[0], tones[1], atol=1e-12)


def test_lever_arm_dies_away_and_goes_through_the_gain() -> None:
    at = scene(["z-up", "z-up"])
    late = Scene(at.recipe, at.visits, at.visit, at.time_s, np.array([0.0, 0.3]))
    base = BaseResponse(np.zeros((1, 3)), 2 * np.eye(3)[None])
    got = reads("lever-arm", [0.1, 0, 0], late, base=base, time_constant_s=0.15)[:, 0]
    np.testing.assert_allclose(got, [0.2, 0.2 * np.exp(-2)], atol=1e-15)


def test_step_and_group_offset() -> None:
    at = scene(["z-up"] * 3)
    np.testing.assert_allclose(reads("step", [0.1] * 3, at, at_s=10.0)[:, 0], [0, 0.1, 0.1], atol=1e-15)
    np.testing.assert_allclose(reads("group-offset", [0.1, 0.2, 0.3], at)[2], [0.1, 0.2, 1.3], atol=1e-15)


def test_gold_drift_passes_on_to_the_unit_where_gold_is_the_truth() -> None:
    """Gold reads 0.1 too much on the nest's x: the true x is 0.1 less; the unit sits turned, so for it 0.1 more."""
    gold = {"source": "gold", "gold": {"serial": "G1", "due": "2030-01-01"}}
    one = np.zeros(1, np.int32)
    table = SampleTable(
        Labels.of(["U"]),
        one,
        one,
        Labels.of(["z-up"]),
        np.zeros(1),
        np.zeros((1, 3)),
        {"seating": Labels.of(["turned"])},
        {},
        np.array([[0.3, 0.0, 1.0]]),
    )
    at = scene_of_table(recipe(reference=gold), table)
    np.testing.assert_allclose(forward(at, BaseResponse.ideal(1)), [[-0.3, 0, 1]], atol=1e-15)
    np.testing.assert_allclose(reads("gold-drift", [0.1, 0, 0], at), [[-0.2, 0, 1]], atol=1e-15)


def test_converter_first_then_decoding() -> None:
    """1.04 is clipped to 1.0, lies on the grid of 0.25, doubles to 2, and goes to the y axis with the other sign."""
    at = scene(["x-up"])
    kinds: dict[str, Any] = {
        name: plugins.load("station.model.effects", name)
        for name in ("clipping", "quantization", "wrong-scale", "axis-permutation")
    }
    size = {"clipping": 1.0, "quantization": 0.25, "wrong-scale": 2.0}
    size["axis-permutation"] = kinds["axis-permutation"].read_size("y,-x,z")
    active = {name: ActiveEffect(kinds[name](s), np.full((1, 1), s), "unit") for name, s in size.items()}
    got = convert_output(at, np.array([[1.04, 0.13, -0.12]]), active)
    np.testing.assert_allclose(got, [[0.5, -2.0, 0.0]], atol=1e-15)
    np.testing.assert_array_equal(
        convert_output(at, np.array([[1.04, 0.13, -0.12]]), dict(reversed(active.items()))), got
    )


# --- sizes, streams, names -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "in_gyro", "power"),
    [
        ("u", "deg/s", 1),
        ("1/u", "1/deg/s", -1),
        ("1/u²", "1/deg/s²", -2),
        ("u/degC", "deg/s/degC", 1),
        ("u·s/degC", "deg/s·s/degC", 1),
        ("1", "1", 0),
        ("rad", "rad", 0),
        ("1/degC", "1/degC", 0),
    ],
)
def test_sizes_follow_the_stimulus(unit: str, in_gyro: str, power: int) -> None:
    """A size given for 1 g is scaled by the stimulus to the power of u in its unit."""
    parameter = Parameter("coefficient", unit, 1.0, 0.0, 2.0, "here")
    rates = [{"name": "a", "rate": [0, 0, 100.0]}, {"name": "b", "rate": [30.0, 40.0, 0]}]
    gyro = recipe(sensor="gyroscope", unit="deg/s", reference={"source": "rate"}, positions=rates)
    assert stimulus_strength(gyro) == 100.0
    assert parameter.scale(gyro) == pytest.approx(100.0**power)
    assert parameter.unit_in("deg/s") == in_gyro


def test_streams_are_independent_and_repeatable() -> None:
    one, again, other = (random_stream(1, key).standard_normal(1000) for key in ("a", "a", "b"))
    np.testing.assert_array_equal(one, again)
    assert abs(np.corrcoef(one, other)[0, 1]) < 4 / np.sqrt(1000)


def test_a_common_scalar_is_exactly_the_size() -> None:
    effect = parse_effect("local-gravity", recipe(), "-0.002")
    np.testing.assert_array_equal(effect.coefficients(("common",), 5), [[-0.002]])


@pytest.mark.parametrize(
    ("name", "size", "printed"),
    [
        ("quadratic", "much", "Size 'much' of quadratic is not a number; write for example quadratic=0.0003 (1/g)"),
        ("quadratic", "nan", "Size 'nan' of quadratic is not a number"),
        ("axis-permutation", "x,x,z", "Mapping 'x,x,z' of axis-permutation must name each axis once"),
        ("quadratc", None, "There is no effect 'quadratc'; the nearest are quadratic, cross-quadratic"),
    ],
)
def test_bad_sizes_and_names_are_sentences(name: str, size: str | None, printed: str) -> None:
    with pytest.raises(UsageError, match=printed.replace("(", r"\(").replace(")", r"\)")):
        parse_effect(name, recipe(), size)


def test_a_cause_that_the_sensor_cannot_feel_is_refused() -> None:
    field = {"source": "field", "magnitude": 50.0}
    compass = recipe(sensor="magnetometer", unit="uT", reference=field)
    with pytest.raises(UsageError, match="local-gravity cannot act on a magnetometer, only on what measures"):
        parse_effect("local-gravity", compass)
    assert parse_effect("quadratic", compass).size == pytest.approx(3e-4 / 50)
