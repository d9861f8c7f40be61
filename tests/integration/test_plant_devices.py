"""Devices as plants have them: no write-back, no switch, no serial, axes in two messages; each in a whole run."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from station.domain.run.progress import Event, UnitDone
from station.errors import ProductError, RecipeError
from station.service.stop_request import StopRequest
from station.wiring.bench import Bench
from station.wiring.jobs import load_job
from tests.fakes import fixture_run
from tests.fakes import plant_device as plant
from tests.fakes.fixture_run import Ran

SERIAL = "SN0001"
NO_MAP: dict[str, Any] = dict.fromkeys(
    ("matrix", "offset", "stores", "output", "unlock", "valid", "checksum", "temperature", "record", "configuration")
)
PLAIN: dict[str, Any] = {"order": ["matrix", "offset"], **dict.fromkeys(NO_MAP, None)}


def outcome(ran: Ran) -> tuple[str, list[str]]:
    found = ran.results[SERIAL]
    return str(found.outcome), [r.sentence for r in found.reasons]


def test_a_device_without_a_map_is_measured_and_certified_and_nothing_is_written(tmp_path: Path) -> None:
    ran = fixture_run.run(tmp_path, recipe=plant.recipe(tmp_path, device_map={**NO_MAP, "order": None}))
    found = ran.results[SERIAL]
    assert outcome(ran) == ("PASS", [])
    assert (found.written, found.verified) == (False, False)
    assert found.fit is not None and found.fit.calibration is not None
    assert ran.memory(SERIAL) == {}
    assert not ran.life(SERIAL)["writes"]


def test_a_map_that_leaves_open_what_the_readings_are_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ProductError, match="does not say whether the readings are raw or compensated"):
        load_job(plant.recipe(tmp_path, device_map={"output": None}))
    with pytest.raises(ProductError, match="say as `sends` whether"):
        load_job(plant.recipe(tmp_path, device_map={"output": "none"}))
    with pytest.raises(ProductError, match="sends is for a device without an output switch"):
        load_job(plant.recipe(tmp_path, device_map={"sends": "raw"}))


@pytest.mark.parametrize("sends", ["raw", "compensated"])
def test_a_device_without_a_switch_is_calibrated_by_what_it_sends(tmp_path: Path, sends: str) -> None:
    """Twice: what the device already holds the second time must not become the coefficients of a perfect one."""
    recipe = plant.recipe(tmp_path, device_map={"output": "none", "sends": sends})
    first = fixture_run.run(tmp_path, recipe=recipe)
    assert outcome(first) == ("PASS", [])
    held = np.array(first.coefficients(SERIAL))
    assert abs(held[0] - 1) > 1e-3  # the unit is no perfect one
    second = fixture_run.run(tmp_path, recipe=recipe)
    assert outcome(second) == ("PASS", [])
    np.testing.assert_allclose(second.coefficients(SERIAL), held, atol=5e-4)


def test_the_label_alone_may_say_who_a_unit_is(tmp_path: Path) -> None:
    ran = fixture_run.run(tmp_path, recipe=plant.recipe(tmp_path, device_map={"serial": "label"}))
    assert outcome(ran) == ("PASS", [])
    assert ran.stored(SERIAL, "identity")["serial_from"] == "label"
    assert ran.stored(SERIAL, "identity")["kept_serial"] is None


def test_no_identity_is_asked_of_a_product_that_names_none(tmp_path: Path) -> None:
    recipe = plant.recipe(tmp_path, product={"identity": None})
    faults = tuple(f"{SERIAL}/refuse:index={i},code=0x06020000" for i in ("0x1000", "0x1008", "0x1009"))
    ran = fixture_run.run(tmp_path, recipe=recipe, faults=faults)
    assert outcome(ran) == ("PASS", [])


def test_a_map_may_leave_out_save_and_restore(tmp_path: Path) -> None:
    job, _ = load_job(plant.recipe(tmp_path, device_map={"restore": None}))
    assert job.product.map.restore is None


def test_an_offset_alone_is_written_where_the_device_keeps_no_more(tmp_path: Path) -> None:
    only = {**PLAIN, "offset": {"index": 0x2102}, "order": ["offset"], "output": "none", "sends": "raw"}
    ran = fixture_run.run(tmp_path, recipe=plant.recipe(tmp_path, "one-point", device_map=only, verify=None, limits={}))
    result, reasons = outcome(ran)
    assert (result, reasons) == ("PASS", [])
    assert ran.memory(SERIAL)["2102:01"] != 0
    assert ran.memory(SERIAL)["2101:01"] == 1.0


def test_gains_do_not_fit_into_a_device_that_keeps_an_offset(tmp_path: Path) -> None:
    only = {**PLAIN, "offset": {"index": 0x2102}, "order": ["offset"], "output": "none", "sends": "raw"}
    with pytest.raises(RecipeError, match="keeps an offset only"):
        fixture_run.run(tmp_path, recipe=plant.recipe(tmp_path, device_map=only))


TWO = {
    ' SG_ Z : 48|16@1- (6.25E-005,0) [-2.048|2.0479375] "g" STATION\n': (
        '\nBO_ 897 SECOND: 2 SENSOR\n SG_ Z : 0|16@1- (6.25E-005,0) [-2.048|2.0479375] "g" STATION\n'
    ),
    'CM_ SG_ 385 Z "1/16000 g a bit; at rest with z up it reads +1 g.";\n': "",
}


def two_messages(**join: Any) -> dict[str, Any]:
    sample = {"message": "ACCELERATION", "x": "X", "y": "Y", "z": "SECOND.Z", "counter": "COUNTER"}
    return {"frames": {"dbc": "accelerometer.dbc", "sample": sample, "counter_values": 16, **join}}


@pytest.mark.parametrize("join", [{}, {"join": {"by": "sync"}}])
def test_x_y_and_z_in_two_messages(tmp_path: Path, join: dict[str, Any]) -> None:
    eds = plant.pdo(transmission=1) if join else {}
    recipe = plant.recipe(tmp_path, product=two_messages(**join), dbc=TWO, eds=eds)
    ran = fixture_run.run(tmp_path, recipe=recipe)
    assert outcome(ran) == ("PASS", [])
    held = np.array(ran.coefficients(SERIAL))
    fit = ran.results[SERIAL].fit
    assert fit is not None and fit.calibration is not None
    np.testing.assert_allclose(held[:9], fit.calibration.matrix.ravel(), atol=1e-6)


def test_readings_in_metres_a_second_squared_are_calibrated_in_g(tmp_path: Path) -> None:
    dbc = {f"{a} : {at}|16@1- (6.25E-005,0) [-2.048|2.0479375] \"g\"": f"{a} : {at}|16@1- (6.1291e-4,0) [0|0] \"m/s2\""
           for a, at in (("X", 16), ("Y", 32), ("Z", 48))}  # fmt: skip
    ran = fixture_run.run(tmp_path, recipe=plant.recipe(tmp_path, dbc=dbc))
    assert outcome(ran) == ("PASS", [])


def test_a_unit_of_another_quantity_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ProductError, match="gives readings in 'uT'; the station converts g, m/s²"):
        load_job(plant.recipe(tmp_path, product=two_messages() | {"frames": {
            "dbc": "accelerometer.dbc", "unit": "uT",
            "sample": {"message": "ACCELERATION", "x": "X", "y": "Y", "z": "Z"},
        }}))  # fmt: skip


def test_what_the_tumble_needed_is_set_again_for_the_verification_and_put_back(tmp_path: Path) -> None:
    """Event timer 0 in flash: set for the run, for the verification after the reset too, and 0 in the end."""
    ran = fixture_run.run(tmp_path, recipe=plant.recipe(tmp_path, eds=plant.pdo(event_timer_ms=0)))
    assert outcome(ran) == ("PASS", [])
    assert ran.memory(SERIAL)["1800:05"] == 0


KEEPS_TYPE = "SN0001/refuse:index=0x1800,sub=2,access=write,code=0x06010002"


@pytest.mark.parametrize(
    ("transmission", "faults", "syncs"),
    [
        (240, (), 1),
        (3, (KEEPS_TYPE,), 3),
        (1, ("SN0002/holds:index=0x1800,sub=2,value=3",), 1),
    ],
    ids=["no bus carries so many", "it keeps its type", "units differ"],
)
def test_a_pdo_follows_each_sync_for_the_run_or_gets_as_many_as_it_waits_for(
    tmp_path: Path, transmission: int, faults: tuple[str, ...], syncs: int
) -> None:
    sent: list[float] = []

    def count(bench: Bench) -> Bench:
        repeat = bench.station.bus.repeat

        def counted(can_id: int, data: bytes, period_s: float) -> Any:
            sent.append(period_s)
            return repeat(can_id, data, period_s)

        vars(bench.station.bus)["repeat"] = counted
        return bench

    recipe = plant.recipe(tmp_path, eds=plant.pdo(transmission))
    ran = fixture_run.run(tmp_path, recipe=recipe, wrap=count, units=2 if transmission == 1 else 1, faults=faults)
    assert {str(result.outcome) for result in ran.results.values()} == {"PASS"}
    assert sent and sent == pytest.approx([0.01 / syncs] * len(sent))
    assert ran.memory(SERIAL)["1800:02"] == transmission


def test_a_recipe_and_a_product_of_one_name_do_not_meet(tmp_path: Path) -> None:
    plant.recipe(tmp_path)
    path = tmp_path / "plant.yaml"
    path.write_text((tmp_path / "six-point-changed.yaml").read_text())
    job, source = load_job(path)
    assert source.product == tmp_path / "dbc" / "plant.yaml"
    assert job.product.name == "plant"
    with pytest.raises(RecipeError):
        load_job(tmp_path / "dbc" / "plant.yaml")


def test_a_pdo_is_set_up_as_the_map_says_and_put_back(tmp_path: Path) -> None:
    """Two seats: each gets the identifier of its own node; y and x change places, and the DBC with them."""
    mapping = [0x21130108, 0x21130208, 0x21130310, 0x21130410, 0x21130510]
    swapped = [*mapping[:2], mapping[3], mapping[2], mapping[4]]
    setup = {"number": 1, "can_id": 0x181, "transmission": 255, "event_timer_ms": 10, "mapping": swapped}
    eds, dbc = plant.pdo(event_timer_ms=0) | plant.mappable(), {"X : 16|16": "X : 32|16", "Y : 32|16": "Y : 16|16"}
    recipe = plant.recipe(tmp_path, device_map={"pdo": [setup]}, eds=eds, dbc=dbc)
    ran = fixture_run.run(tmp_path, units=2, recipe=recipe)
    assert {str(r.outcome) for r in ran.results.values()} == {"PASS"}
    held = ran.memory(SERIAL)
    assert [held[f"1A00:{sub:02X}"] for sub in range(1, 6)] == mapping
    assert (held["1800:01"], held["1800:02"], held["1800:05"]) == (0x191, 254, 0)


@pytest.mark.parametrize(
    ("fault", "ended", "failed"),
    [
        (("only-idle",), "PASS", False),
        (("holds:index=0x1800,sub=5,value=0", "refuse:index=0x1800,sub=5,access=write,at=2"), "FAIL", True),
    ],
    ids=["writes only while idle", "a setting not put back"],
)
def test_a_device_is_left_in_the_state_found(tmp_path: Path, fault: tuple[str, ...], ended: str, failed: bool) -> None:
    states: list[str] = []

    def look(event: Event, _stop: StopRequest, bench: Bench) -> None:
        if isinstance(event, UnitDone):
            bench.station.clock.sleep(1.5)  # its heartbeat says the state
            states.append(bench.station.device(event.result.seat.node).state())

    ran = fixture_run.run(tmp_path, hook=look, faults=fault)
    assert outcome(ran)[0] == ended
    assert states == ["pre-operational"]
    assert ("not-left-as-found" in {event["kind"] for event in ran.life(SERIAL)["events"]}) is failed
