"""Every way to a device's objects keeps what SDO promises: one outcome, one sentence, nothing half written unnoticed.

The same run, faults, deaths and recovery over CANopen, UDS and frame templates; a protocol more is a product more.
"""

import struct
from pathlib import Path

import pytest

from station.cli._recover import recover_unit
from station.config.products import load_product
from station.config.search_path import shipped_folder
from station.domain.core.types import Outcome
from station.errors import ProductError
from station.wiring.jobs import check_product
from station.wiring.run_order import RunOrder
from tests.fakes import fixture_run
from tests.fakes.fixture_run import Ran
from tests.fakes.killed_run import killed

SERIAL = "SN0001"
#: Product of each protocol, and what its device port is called in tests/fakes/killed_run.py.
PROTOCOLS = {"canopen": "accelerometer", "uds": "accelerometer-uds", "template": "accelerometer-template"}
PORTS = {"canopen": "device", "uds": "object-device", "template": "object-device"}
OTHERS = tuple(name for name in PROTOCOLS if name != "canopen")

#: Fault of the device, outcomes that it may have, what the flash then holds. {first} and {last}: the first object that
#: is written, and the last coefficient. One device may be able to tell of a fault what another cannot.
FAULTS = (
    ("deaf", {Outcome.ERROR}, "old"),
    ("silent:{first},access=write", {Outcome.ERROR}, "old"),
    ("late:seconds=1.4,{first},access=write,times=1", {Outcome.ERROR}, "old"),
    ("refuse:{last},access=write,code=0x06090030", {Outcome.FAIL}, "old"),
    ("wrong-object:value=0x2fff,{last},access=write", {Outcome.ERROR}, "old"),
    ("reads:{last},value=0.25,at=2", {Outcome.FAIL}, "old"),
    ("twice", {Outcome.ERROR}, "old"),
    ("stale", {Outcome.ERROR}, "old"),
    ("early", {Outcome.PASS, Outcome.ERROR}, ""),
    ("reboot:{last},access=write", {Outcome.ERROR, Outcome.FAIL}, "old"),
    ("power-cut:{last},access=write", {Outcome.ERROR}, "old"),
    ("other-unit:{last},access=write,value=77", {Outcome.ERROR}, ""),
    ("save-fails", {Outcome.FAIL}, "old"),
    ("save-lies", {Outcome.FAIL}, "old"),
    ("save-torn", {Outcome.ERROR}, "mixed"),
    ("save-torn:seconds=1", {Outcome.FAIL, Outcome.ERROR}, "mixed"),
    ("forgets:{last}", {Outcome.FAIL}, "mixed"),
    ("no-boot-up:at=2", {Outcome.ERROR}, "new"),
)


def recipe(folder: Path, protocol: str, dwell_s: float = 0.1) -> str:
    """Few and short stops: what is tried is the way to the objects."""
    short = {"dwell": {"time_s": dwell_s}, "settle": {"time_s": 0.05}, "verify": None, "limits": {}}
    return fixture_run.recipe(folder, "one-point", product=PROTOCOLS[protocol], **short)


def places(protocol: str) -> dict[str, str]:
    """The first and the last coefficient of a product, as a fault names them."""
    cells = [number for _, number in load_product(PROTOCOLS[protocol]).map.coefficients()]
    return {k: f"index={n.index},sub={n.sub}" for k, n in (("first", cells[0]), ("last", cells[-1]))}


def flash(ran: Ran, protocol: str) -> str:
    """What the device's memory holds of the plan of the newest attempt: new, mixed, or old: nothing of it.

    All coefficients of these products are REAL32, which the memory keeps as numbers.
    """
    memory, plan = ran.memory(SERIAL), ran.stored(SERIAL, "write-plan")
    if plan is None or not memory:
        return "old"
    cells = (number.address for _, number in load_product(PROTOCOLS[protocol]).map.coefficients())
    keys = [f"{index:04X}:{sub:02X}" for index, sub in cells]
    same = [struct.pack("<f", memory[key]).hex() == plan["objects"][key] for key in keys]
    return "new" if all(same) else "mixed" if any(same) else "old"


@pytest.mark.parametrize(
    ("protocol", "old", "new", "says"),
    [
        ("uds", "identity: {name: accelerometer}", "identity: {vendor: 5}", "identity.vendor is an object of CANopen"),
        ("template", "  save:", "  record: {index: 0x2100, length: 36}\n  save:", "record has 36 bytes"),
    ],
)
def test_a_product_that_its_protocol_cannot_serve_is_refused(
    tmp_path: Path, protocol: str, old: str, new: str, says: str
) -> None:
    shipped = shipped_folder() / "dbc"
    for name in ("accelerometer.dbc", "accelerometer.eds", "accelerometer-uds.eds"):
        (tmp_path / name).write_bytes((shipped / name).read_bytes())
    text = (shipped / f"{PROTOCOLS[protocol]}.yaml").read_text(encoding="utf-8")
    before, key, after = text.rpartition(old)
    assert key
    (tmp_path / "changed.yaml").write_text(before + new + after, encoding="utf-8")
    with pytest.raises(ProductError, match=says):
        check_product(str(tmp_path / "changed.yaml"))


@pytest.mark.parametrize("protocol", OTHERS)
def test_a_good_unit_is_calibrated_written_and_verified(tmp_path: Path, protocol: str) -> None:
    # As long as a device that says when heartbeats are due, but has none, may be silent.
    ran = fixture_run.run(tmp_path, recipe=recipe(tmp_path, protocol, dwell_s=3.0))
    r = ran.results[SERIAL]
    assert (r.outcome, r.reasons, r.written, r.verified) == (Outcome.PASS, (), True, True)
    assert flash(ran, protocol) == "new"


#: Both protocols share the client; of the templates every third fault shows that their bytes are right.
TRIED = [(p, *fault) for p, every in (("uds", 1), ("template", 3)) for fault in FAULTS[::every]]


@pytest.mark.parametrize(("protocol", "fault", "outcomes", "holds"), TRIED, ids=[f"{t[0]} {t[1]}" for t in TRIED])
def test_a_fault_has_one_outcome_and_leaves_nothing_half_written_unnoticed(
    tmp_path: Path, protocol: str, fault: str, outcomes: set[Outcome], holds: str
) -> None:
    text = f"{SERIAL}/{fault.format(**places(protocol))}"
    ran = fixture_run.run(tmp_path, recipe=recipe(tmp_path, protocol), faults=(text,))
    r = ran.results[SERIAL]
    assert r.outcome in outcomes, r.reasons
    assert bool(r.reasons) is (r.outcome is not Outcome.PASS)
    assert all(reason.sentence.isprintable() and len(reason.sentence) < 500 for reason in r.reasons)
    state = flash(ran, protocol)
    assert not holds or state == holds, [x.sentence for x in r.reasons]
    if r.outcome is Outcome.PASS:
        assert state == "new" and r.verified
    if state == "mixed":
        assert (ran.stored(SERIAL, "device-state") or {}).get("state") != "new"
        again = fixture_run.run(tmp_path, recipe=recipe(tmp_path, protocol), seed=3)
        assert again.results[SERIAL].outcome is Outcome.FAIL
        assert "station recover SN0001 --restore" in again.results[SERIAL].reasons[0].sentence


#: Where the process dies: port, method, call; below 0: just after it. Every point: tests/endurance/torture_kill.py.
DEATHS = (
    ("uds", "device", "download", 5),
    ("uds", "device", "download", -16),
    ("template", "device", "nmt", -2),
)


@pytest.mark.parametrize(("protocol", "port", "method", "number"), DEATHS)
def test_after_a_death_the_next_start_knows_everything(
    tmp_path: Path, protocol: str, port: str, method: str, number: int
) -> None:
    of_run = recipe(tmp_path, protocol)
    assert killed(tmp_path, PORTS[protocol] if port == "device" else port, method, number, of_run) == 137
    state = flash(Ran(tmp_path), protocol)
    assert Ran(tmp_path).life(SERIAL)["outcome"] is None
    assert state in ("old", "new"), "flash is written whole or not at all"
    again = fixture_run.run(tmp_path, recipe=of_run, seed=3)
    assert again.lives(SERIAL)[0]["outcome"] == str(Outcome.INTERRUPTED)
    assert again.results[SERIAL].outcome is Outcome.PASS
    assert flash(again, protocol) == "new"


@pytest.mark.parametrize("restore", [True, False])
@pytest.mark.parametrize("protocol", OTHERS)
def test_recovery_makes_a_half_written_unit_whole(tmp_path: Path, protocol: str, restore: bool) -> None:
    of_run = recipe(tmp_path, protocol)
    fixture_run.run(tmp_path, recipe=of_run)
    before = Ran(tmp_path).memory(SERIAL)
    fixture_run.run(tmp_path, recipe=of_run, seed=2, faults=("save-torn",))
    order = RunOrder(simulate=True, recipe=of_run, database=tmp_path / "station.db", device_state=tmp_path / "devices")
    assert recover_unit(order, SERIAL, None, None, as_json=False) == 1
    assert recover_unit(order, SERIAL, None, "restore" if restore else "continue", as_json=False) == 0
    coefficients = [n.address for _, n in load_product(PROTOCOLS[protocol]).map.coefficients()]
    keys = [f"{index:04X}:{sub:02X}" for index, sub in coefficients]
    now = Ran(tmp_path).memory(SERIAL)
    assert ([now[k] for k in keys] == [before[k] for k in keys]) is restore
    assert fixture_run.run(tmp_path, recipe=of_run, seed=3).results[SERIAL].outcome is Outcome.PASS
