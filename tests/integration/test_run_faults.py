"""How a run takes faults, beside the table of tests/faults: several units at once, repeats, limits, old values."""

from pathlib import Path

from station.domain.core.types import Outcome
from tests.fakes import fixture_run
from tests.fakes.fixture_run import Ran

FAIL, ERROR, PASS = Outcome.FAIL, Outcome.ERROR, Outcome.PASS


def test_one_bad_unit_does_not_stop_the_others(tmp_path: Path) -> None:
    ran = fixture_run.run(
        tmp_path,
        units=4,
        faults=("SN0001/silent", "SN0002/stuck-axis:value=2", "SN0003/save-fails"),
    )
    assert [r.outcome for r in ran.results.values()] == [ERROR, FAIL, FAIL, PASS]
    assert ran.memory("SN0003") == {}
    assert len(ran.coefficients("SN0004")) == 12


def test_two_devices_under_one_node_id_are_that_nests_trouble(tmp_path: Path) -> None:
    ran = fixture_run.run(tmp_path, units=2, faults=("SN0001/twice",))
    assert [r.outcome for r in ran.results.values()] == [ERROR, PASS]
    assert "two devices share this node id" in ran.results["SN0001"].reasons[0].sentence
    assert ran.fault is None


def test_a_heartbeat_that_never_came_has_no_age(tmp_path: Path) -> None:
    ran = fixture_run.run(tmp_path, faults=("no-boot-up", "heartbeat-stops"))
    assert [x.sentence for x in ran.results["SN0001"].reasons] == [
        "No readable heartbeat has come by 'z-up'; one is due every 0.5 s: check cable, power and firmware."
    ]


def test_a_single_bad_visit_is_measured_once_more(tmp_path: Path) -> None:
    from station.domain.run.progress import VisitRejected

    faulty = fixture_run.run(tmp_path, faults=("frames-lost:fraction=0.002",), seed=3)
    rejected = faulty.of(VisitRejected)
    assert rejected, "the seed must lose a frame in some dwell"
    assert all(e.again for e in rejected)
    assert faulty.results["SN0001"].outcome is PASS
    kinds = [v["kind"] for v in faulty.life("SN0001")["visits"]]
    assert kinds.count("rejected") == len(rejected)
    assert kinds.count("tumble") == 6


def test_a_recipe_without_repeats_takes_the_first_word(tmp_path: Path) -> None:
    name = fixture_run.recipe(tmp_path, visit_repeats=0)
    ran = fixture_run.run(tmp_path, faults=("frames-lost:fraction=0.2",), recipe=name)
    assert [v["kind"] for v in ran.life("SN0001")["visits"]] == ["rejected"]


def test_after_a_refused_write_the_old_values_stand_in_the_device(tmp_path: Path) -> None:
    fixture_run.run(tmp_path)
    before = Ran(tmp_path).memory("SN0001")
    ran = fixture_run.run(tmp_path, seed=5, faults=("refuse:index=0x2102,sub=2,access=write,code=0x06090030",))
    assert ran.results["SN0001"].outcome is FAIL
    assert ran.stored("SN0001", "device-state") == {"state": "old"}
    assert ran.memory("SN0001") == before


def test_limits_decide_and_nothing_is_written_on_fail(tmp_path: Path) -> None:
    name = fixture_run.recipe(tmp_path, limits={"rule": "guard-band", "offset": 0.02})
    ran = fixture_run.run(tmp_path, recipe=name)
    r = ran.results["SN0001"]
    assert r.outcome is FAIL
    assert [x.check for x in r.reasons] == ["offset", "offset"]
    assert r.fit is not None
    assert r.fit.calibration is not None
    printed = f"offset y is {r.fit.calibration.offset[1]:+.5f} g off nominal, beyond 0.02 less the guard band"
    assert printed in r.reasons[1].sentence
    assert not r.written
    assert ran.memory("SN0001") == {}
    assert ran.life("SN0001")["writes"] == []


def test_a_coefficient_that_does_not_fit_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    limits = {"rule": "simple", "offset": 10.0, "residual": 10.0}
    name = fixture_run.recipe(tmp_path, limits=limits, device={"rate_hz": 100, "counter_bits": 4})
    ran = fixture_run.run(tmp_path, recipe=name, effects=("wrong-scale=1.7",))
    r = ran.results["SN0001"]
    assert r.outcome is FAIL
    assert ran.life("SN0001")["writes"] == []
    assert ran.memory("SN0001") == {}


def test_verification_through_the_devices_own_output_can_fail(tmp_path: Path) -> None:
    name = fixture_run.recipe(tmp_path, verify={"limit": 0.00001, "positions": [{"name": "again", "up": "+y"}]})
    ran = fixture_run.run(tmp_path, recipe=name)
    r = ran.results["SN0001"]
    assert (r.outcome, r.written, r.verified) == (FAIL, True, False)
    assert "The device's own output at" in r.reasons[0].sentence


def test_a_product_that_is_too_warm_is_the_stations_fault(tmp_path: Path) -> None:
    ran = fixture_run.run(tmp_path, recipe=fixture_run.recipe(tmp_path, limits={"temperature_degC": [-10, 10]}))
    assert ran.results["SN0001"].outcome is ERROR
    assert "°C, outside -10 to 10 °C." in ran.results["SN0001"].reasons[0].sentence
