"""The process dies in mid-run: nothing recorded is lost, the attempt is INTERRUPTED, a half-written unit is known."""

import shutil
from pathlib import Path

import pytest

from station.domain.core.types import Outcome
from tests.fakes import fixture_run
from tests.fakes.fixture_run import Ran
from tests.fakes.killed_run import killed

#: Where it dies: port, method, call; below 0: just after the call. The run makes 19
#: writes and a save; the fact of one and the intent of the next are one call.
DEATHS = [
    ("store", "begin", -1),
    ("store", "visit", 1),
    ("store", "visit", -6),
    ("store", "result", -4),
    ("store", "write", -2),
    ("device", "download", 9),
    ("device", "download", -15),
    ("store", "write", -21),
    ("device", "download", -22),
    ("device", "nmt", -2),
    ("store", "finish", 1),
    ("store", "finish", -1),
]


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a unit that has passed."""
    folder = tmp_path_factory.mktemp("calibrated") / "folder"
    folder.mkdir()
    fixture_run.run(folder)
    return folder


@pytest.fixture(scope="module")
def half_written(calibrated: Path) -> tuple[Path, list[float]]:
    """A unit whose save lost power half-way: old offset, new matrix or the other way round. Its old values."""
    folder = calibrated.with_name("torn")
    shutil.copytree(calibrated, folder)
    old = Ran(folder).coefficients("SN0001")
    torn = fixture_run.run(folder, seed=2, faults=("save-torn",))
    assert torn.results["SN0001"].outcome is Outcome.ERROR
    assert Ran(folder).coefficients("SN0001") != old
    return folder, old


@pytest.mark.parametrize(("port", "method", "number"), DEATHS)
def test_after_a_death_the_next_start_knows_everything(
    calibrated: Path, tmp_path: Path, port: str, method: str, number: int
) -> None:
    shutil.copytree(calibrated, tmp_path, dirs_exist_ok=True)  # an older calibration is in the flash
    old = Ran(tmp_path).coefficients("SN0001")
    assert killed(tmp_path, port, method, number) == 137
    after = Ran(tmp_path).coefficients("SN0001")
    left = Ran(tmp_path).life("SN0001")
    assert left["outcome"] in (None, "PASS")
    again = fixture_run.run(tmp_path, seed=3)
    assert bool(again.notices) is (left["outcome"] is None)
    assert again.lives("SN0001")[1]["outcome"] == (left["outcome"] or str(Outcome.INTERRUPTED))
    r = again.results["SN0001"]
    if after == old:
        assert r.outcome is Outcome.PASS, r.reasons
    else:
        assert len(after) == 12, "flash is written whole or not at all"
        assert r.outcome is Outcome.PASS
    assert len(again.coefficients("SN0001")) == 12
    assert again.coefficients("SN0001") not in (old, after) or left["outcome"] == "PASS"


def test_a_half_written_unit_is_held_and_the_remedy_named(
    half_written: tuple[Path, list[float]], tmp_path: Path
) -> None:
    shutil.copytree(half_written[0], tmp_path, dirs_exist_ok=True)
    held = fixture_run.run(tmp_path, seed=3)
    r = held.results["SN0001"]
    assert (r.outcome, r.written) == (Outcome.FAIL, False)
    assert "some of its objects hold old values and some new ones" in r.reasons[0].sentence
    assert "station recover SN0001 --restore" in r.reasons[0].sentence
    assert not held.life("SN0001")["writes"]


@pytest.mark.parametrize("restore", [True, False])
def test_recovery_makes_it_whole_and_the_next_run_takes_it(
    half_written: tuple[Path, list[float]], tmp_path: Path, restore: bool
) -> None:
    from station.cli._recover import recover_unit
    from station.wiring.run_order import RunOrder

    torn_folder, old = half_written
    shutil.copytree(torn_folder, tmp_path, dirs_exist_ok=True)
    order = RunOrder(simulate=True, database=tmp_path / "station.db", device_state=tmp_path / "devices")
    assert recover_unit(order, "SN0001", None, None, as_json=False) == 1
    assert recover_unit(order, "SN0001", None, "restore" if restore else "continue", as_json=False) == 0
    stored = Ran(tmp_path).coefficients("SN0001")
    assert (stored == old) is restore
    torn = Ran(tmp_path).lives("SN0001")[1]
    events = [e["detail"]["state"] for e in torn["events"] if e["kind"] == "device-state"]
    assert events == ["mixed", "mixed", "old" if restore else "new"]
    if not restore:
        planned = next(r["document"]["objects"] for r in torn["results"] if r["name"] == "write-plan")
        import struct

        wanted = [struct.unpack("<f", bytes.fromhex(planned[f"2101:{i:02X}"]))[0] for i in range(1, 10)]
        assert stored[:9] == pytest.approx(wanted, abs=0)
    again = fixture_run.run(tmp_path, seed=3)
    assert again.results["SN0001"].outcome is Outcome.PASS


def test_a_unit_nobody_interrupted_needs_no_recovery(
    calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from station.cli._recover import recover_unit
    from station.errors import UsageError
    from station.wiring.run_order import RunOrder

    shutil.copytree(calibrated, tmp_path, dirs_exist_ok=True)
    order = RunOrder(simulate=True, database=tmp_path / "station.db", device_state=tmp_path / "devices")
    before = (tmp_path / "devices" / "SN0001.json").read_text()
    assert recover_unit(order, "SN0001", None, "restore", as_json=False) == 0
    assert "left 'SN0001' half written: there is nothing to recover" in capsys.readouterr().out
    assert (tmp_path / "devices" / "SN0001.json").read_text() == before
    with pytest.raises(UsageError, match="holds no attempt of 'SN9999'"):
        recover_unit(order, "SN9999", None, "restore", as_json=False)
