"""Everything that can be wrong with a device in the run: one outcome, one sentence, and what its flash holds after."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from station.domain.sdo_codes import ABORT
from station.domain.types import Outcome
from tests.fakes import fixture_run
from tests.fakes.fixture_run import Ran

FAIL, ERROR, PASS = Outcome.FAIL, Outcome.ERROR, Outcome.PASS


@dataclass(frozen=True)
class Row:
    """fault → outcome, words of the first reason, and what the flash holds: nothing, all new, or some of each."""

    fault: str
    outcome: Outcome
    words: str
    flash: str = "nothing"

    def __str__(self) -> str:
        return self.fault


ROWS = [
    # who it is
    Row("silent", ERROR, "did not answer the request to read 0x1000:00"),
    Row("reads:index=0x1018,sub=1,value=5", FAIL, "vendor is 0x5, not 0xCA1B0"),
    Row("reads:index=0x1018,sub=2,value=7", FAIL, "product code is 0x7"),
    Row("reads:index=0x1018,sub=3,value=1", FAIL, "revision is 0x1, older"),
    Row("reads:index=0x1000,sub=0,value=0", FAIL, "device type is 0x0"),
    Row("reads:index=0x1018,sub=4,value=9", ERROR, "calls itself 9, but the label SN0001 means 1"),
    Row("refuse:index=0x1018,sub=1,code=0x06020000", FAIL, "refused to read 0x1018:01: there is no such object"),
    Row("twice", ERROR, "two devices share this node id"),
    # answers
    Row("late:seconds=3,at=12,times=1", ERROR, "within 1 s"),
    Row("wrong-object:at=12,times=1,value=8192", ERROR, "1 answers came that belong to other requests"),
    Row("stale:at=30", PASS, "", "new"),
    # the stream
    Row("stream-stops:after_s=6", ERROR, "no readings came at 'x-up'"),
    Row("counter-stuck", FAIL, "the frame counter is stuck"),
    Row("crc-errors:fraction=0.2", FAIL, "frames with a wrong CRC"),
    Row("frames-lost:fraction=0.2", FAIL, "frames lost, at"),
    Row("frames-repeated:fraction=0.2", FAIL, "frames repeated"),
    Row("frames-swapped:fraction=0.2", FAIL, "frames out of order"),
    Row("stuck-axis:value=1", FAIL, "axis y stands still"),
    Row("clock-fast:fraction=0.2", FAIL, "120.0 Hz at 'z-up', but the recipe says 100 Hz"),
    Row("emergency:code=0x4210,after_s=6", FAIL, "emergency 0x4210 (register 0x01) at 'x-up'"),
    Row("heartbeat-stops:after_s=5", FAIL, "no heartbeat for"),
    Row("spontaneous-reset:after_s=6", FAIL, "restarted by itself at 'x-up'"),
    # the write
    Row("other-unit:at=33,value=77", ERROR, "now holds a unit that calls itself 77, but it was 1"),
    Row("reads:index=0x2101,sub=3,value=0.5", FAIL, "matrix.xz at 0x2101:03 reads back 0000003f"),
    Row("reads:index=0x2105,sub=0,value=3", FAIL, "computes the checksum 00000003 over its coefficients"),
    Row("late:seconds=3,index=0x2101,sub=4,access=write,times=1", ERROR, "request to take 0x2101:04"),
    Row("reboot:at=60", FAIL, "restarted by itself"),
    Row("power-cut:at=60,seconds=1", FAIL, "restarted by itself"),
    Row("power-cut:at=60", ERROR, "did not answer"),
    # save and reset
    Row("save-fails", FAIL, "0x1010:01: its hardware failed"),
    Row("save-lies", FAIL, "holds old values after save and reset"),
    Row("save-torn", ERROR, "sent no boot-up message", "mixed"),
    Row("late:seconds=6,index=0x1010", PASS, "", "new"),
    Row("no-boot-up:at=2", ERROR, "sent no boot-up message within 5 s", "new"),
    *(
        Row(f"refuse:index=0x2102,sub=2,access=write,code=0x{code:08X}", FAIL, f"(abort code 0x{code:08X})")
        for code in ABORT
    ),
]


def held(ran: Ran, serial: str) -> str:
    """What the flash holds of the calibration that the run computed: nothing, new, or mixed."""
    memory = ran.memory(serial)
    planned = ran.kept(serial, "write-plan")
    if not memory:
        return "nothing"
    assert planned is not None, "something was saved although nothing was planned"
    fit = ran.results[serial].fit
    assert fit is not None
    assert fit.calibration is not None
    wanted = [*fit.calibration.matrix.ravel(), *fit.calibration.offset]
    same = [abs(a - b) < 1e-6 for a, b in zip(ran.coefficients(serial), wanted, strict=False)]
    return "new" if same and all(same) else "mixed"


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_one_outcome_one_sentence_and_nothing_half_written(tmp_path: Path, row: Row) -> None:
    ran = fixture_run.run(tmp_path, faults=(row.fault,))
    r = ran.results["SN0001"]
    assert r.outcome is row.outcome, r.reasons
    assert row.words in (r.reasons[0].sentence if r.reasons else "")
    assert all(reason.sentence.isprintable() and len(reason.sentence) < 500 for reason in r.reasons)
    assert held(ran, "SN0001") == row.flash
    assert ran.parked
    life = ran.life("SN0001")
    assert life["outcome"] == str(row.outcome)
    kept = ran.kept("SN0001", "verdict")
    assert [x["sentence"] for x in kept["reasons"]] == [x.sentence for x in r.reasons]
    if row.outcome is not PASS:
        assert not r.verified
    if row.flash == "mixed":
        assert ran.kept("SN0001", "device-state") is None or ran.kept("SN0001", "device-state")["state"] != "new"


def test_one_bad_unit_does_not_stop_the_others(tmp_path: Path) -> None:
    ran = fixture_run.run(
        tmp_path,
        units=4,
        faults=("SN0001/silent", "SN0002/stuck-axis:value=2", "SN0003/save-fails"),
    )
    assert [r.outcome for r in ran.results.values()] == [ERROR, FAIL, FAIL, PASS]
    assert ran.memory("SN0003") == {}
    assert len(ran.coefficients("SN0004")) == 12


def test_a_single_bad_visit_is_measured_once_more(tmp_path: Path) -> None:
    from station.domain.progress import VisitRejected

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
    assert ran.kept("SN0001", "device-state") == {"state": "old"}
    assert ran.memory("SN0001") == before


def test_limits_decide_and_nothing_is_written_on_fail(tmp_path: Path) -> None:
    name = fixture_run.recipe(tmp_path, limits={"rule": "guard-band", "offset": 0.02})
    ran = fixture_run.run(tmp_path, recipe=name)
    r = ran.results["SN0001"]
    assert r.outcome is FAIL
    assert [x.check for x in r.reasons] == ["offset", "offset"]
    assert "offset y is +0.03686 g, beyond 0.02 less the guard band" in r.reasons[1].sentence
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
    assert "the device's own output is" in r.reasons[0].sentence


def test_a_product_that_is_too_warm_is_the_stations_fault(tmp_path: Path) -> None:
    ran = fixture_run.run(tmp_path, recipe=fixture_run.recipe(tmp_path, limits={"temperature_degC": [-10, 10]}))
    assert ran.results["SN0001"].outcome is ERROR
    assert "degC at 'z-up' is outside -10 to 10 degC" in ran.results["SN0001"].reasons[0].sentence


@pytest.mark.parametrize(
    ("positioner", "words"),
    [
        ({"kind": "simulated", "fault": "stuck", "after": 2}, "did not reach position"),
        ({"kind": "simulated", "fault": "slow", "after": 2}, "did not reach position"),
        ({"kind": "simulated", "fault": "wrong-place", "after": 2}, "degrees away from position"),
        ({"kind": "simulated", "fault": "wrong-place", "after": 0, "encoder_lies": True}, "is up instead of"),
    ],
)
def test_a_positioner_that_fails_is_the_stations_fault(
    tmp_path: Path, positioner: dict[str, object], words: str
) -> None:
    ran = fixture_run.run(tmp_path, units=2, config=fixture_run.config(tmp_path, positioner=positioner))
    assert [r.outcome for r in ran.results.values()] == [ERROR, ERROR]
    assert all(words in r.reasons[0].sentence for r in ran.results.values())
    assert ran.memory("SN0001") == ran.memory("SN0002") == {}
