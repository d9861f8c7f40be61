"""Every fault of a simulated device does what its description says, and the station's device sees it for what it is."""

from collections.abc import Callable

import numpy as np
import pytest

from station.adapters.simulated_device.device_fault import KINDS, InjectedFault, parse
from station.domain.can.decode import Samples, decode_samples
from station.errors import BusFault, DeviceRefused, DeviceSilent, UsageError
from tests.fakes.device_rig import DeviceRig

Rig = Callable[..., DeviceRig]
Check = Callable[[DeviceRig], None]
ONE = bytes.fromhex("0000803f")
RATE = 1000.0


def got(rig: DeviceRig, duration_s: float = 2.0) -> Samples:
    rig.station.nmt("start")
    return decode_samples(rig.readings(duration_s), rig.layout, rig.node)


def deaf(rig: DeviceRig) -> None:
    with pytest.raises(DeviceSilent, match="check power, wiring"):
        rig.station.identify()


def silent(rig: DeviceRig) -> None:
    rig.unlock()
    with pytest.raises(DeviceSilent):
        rig.station.download(0x2101, 1, bytes.fromhex("cdcc8c3f"))
    assert rig.station.upload(0x2101, 1) == bytes.fromhex("cdcc8c3f")  # it was done all the same


def late(rig: DeviceRig) -> None:
    """A's confirmation comes while B is refused; nothing is taken for B's."""
    rig.unlock()
    with pytest.raises(DeviceSilent):
        rig.station.download(0x2101, 1, ONE)
    with pytest.raises(DeviceRefused) as caught:
        rig.station.download(0x2101, 2, bytes.fromhex("0000a041"))
    assert caught.value.code == 0x06090031
    assert rig.station.sdo.dropped == 1


def stale(rig: DeviceRig) -> None:
    assert rig.station.upload(0x1000, 0)  # nothing to repeat yet
    assert rig.station.upload(0x1018, 1)
    with pytest.raises(BusFault, match="two devices share this node id"):
        rig.station.upload(0x1018, 2)


def stale_once(rig: DeviceRig) -> None:
    assert rig.station.identify().serial == 42
    assert rig.station.sdo.dropped == 1


def wrong_object(rig: DeviceRig) -> None:
    with pytest.raises(DeviceSilent, match="1 answer came that does not fit the request"):
        rig.station.upload(0x2106, 0)


def refuse(rig: DeviceRig) -> None:
    assert rig.station.upload(0x2106, 0) == b"\1"  # reading is not refused
    with pytest.raises(DeviceRefused, match=r"0x2106:00: .*present state"):
        rig.station.download(0x2106, 0, b"\0")


def only_idle(rig: DeviceRig) -> None:
    rig.station.nmt("start")
    refuse(rig)
    rig.station.nmt("pre-operational")
    rig.station.download(0x2106, 0, b"\0")
    assert rig.station.upload(0x2106, 0) == b"\0"


def wrong_toggle(rig: DeviceRig) -> None:
    with pytest.raises(DeviceSilent, match="1 answer came"):
        rig.station.upload(0x1008, 0)


def lost_segment(rig: DeviceRig) -> None:
    data = bytes(i % 251 for i in range(3000))
    rig.station.download(0x2120, 0, data)
    assert rig.station.upload(0x2120, 0) == data


def twice(rig: DeviceRig) -> None:
    with pytest.raises(BusFault, match="two devices share this node id"):
        rig.station.identify()


def reads(rig: DeviceRig) -> None:
    rig.unlock()
    rig.station.download(0x2102, 1, bytes.fromhex("cdcccc3d"))
    assert rig.station.upload(0x2102, 1) == bytes.fromhex("0000803e")


def reboot(rig: DeviceRig) -> None:
    rig.unlock()
    with pytest.raises(DeviceSilent):
        rig.station.download(0x2101, 1, ONE)
    rig.clock.sleep(0.5)
    assert rig.station.boot_ups() == 2


def power_cut(rig: DeviceRig) -> None:
    rig.unlock()
    rig.station.download(0x2102, 1, bytes.fromhex("cdcccc3d"))
    with pytest.raises(DeviceSilent):
        rig.station.upload(0x2102, 1)
    rig.clock.sleep(2.0)
    assert rig.station.upload(0x2102, 1) == bytes(4)


def power_cut_for_good(rig: DeviceRig) -> None:
    for _ in range(3):
        with pytest.raises(DeviceSilent):
            rig.station.upload(0x2102, 1)
        rig.clock.sleep(5.0)


def save_fails(rig: DeviceRig) -> None:
    with pytest.raises(DeviceRefused, match="hardware error"):
        rig.station.download(0x1010, 1, b"save")
    assert rig.memory.objects() == {}


def save_lies(rig: DeviceRig) -> None:
    rig.station.download(0x1010, 1, b"save")
    assert rig.memory.objects() == {}


def save_torn(rig: DeviceRig) -> None:
    rig.unlock()
    for sub in (1, 2, 3):
        rig.station.download(0x2102, sub, bytes.fromhex("cdcccc3d"))
    with pytest.raises(DeviceSilent):
        rig.station.download(0x1010, 1, b"save", 1.0)
    rig.clock.sleep(2.0)
    assert [rig.station.upload(0x2102, sub) for sub in (1, 2, 3)] == [bytes.fromhex("cdcccc3d"), bytes(4), bytes(4)]


def other_unit(rig: DeviceRig) -> None:
    assert rig.station.identify().serial == 42
    assert rig.station.identify().serial == 43


def no_boot_up(rig: DeviceRig) -> None:
    rig.clock.settle()
    rig.station.nmt("reset-node")
    with pytest.raises(DeviceSilent, match=r"sent no boot-up message within 2 s"):
        rig.station.wait_boot_up(2.0)
    assert rig.station.identify().serial == 42


def heartbeat_stops(rig: DeviceRig) -> None:
    rig.clock.sleep(0.9)
    assert rig.station.heartbeat_age_s() < 0.5
    rig.clock.sleep(5.0)
    assert rig.station.heartbeat_age_s() > 4.5


def heartbeat_slow(rig: DeviceRig) -> None:
    rig.clock.sleep(1.0)
    before = rig.station.heartbeats()
    rig.clock.sleep(20.0)
    # Every seventh of those that it says to send, three a second.
    assert 9 <= rig.station.heartbeats() - before <= 10


def emergency(rig: DeviceRig) -> None:
    rig.station.nmt("start")
    rig.clock.sleep(0.9)
    assert rig.station.emergencies() == ()
    rig.clock.sleep(0.2)
    assert [e.code for e in rig.station.emergencies()] == [0x4210]


def emergency_at(rig: DeviceRig) -> None:
    rig.clock.sleep(3.5)
    assert [e.code for e in rig.station.emergencies()] == [0x8120]


def spontaneous_reset(rig: DeviceRig) -> None:
    rig.clock.sleep(5.0)
    assert rig.station.boot_ups() == 2


def counter_stuck(rig: DeviceRig) -> None:
    assert got(rig).frame_errors.counter.stuck


def status(rig: DeviceRig) -> None:
    shown = got(rig).status
    assert shown is not None
    assert np.all(shown & 1)


def crc_errors(rig: DeviceRig) -> None:
    found = got(rig)
    # 2,000 trials at 5 %: mean 100, standard deviation 9.7; five of those.
    assert abs(found.frame_errors.crc_errors - 100) < 49
    assert found.usable.sum() == len(found) - found.frame_errors.crc_errors


def frames_lost(rig: DeviceRig) -> None:
    found = got(rig)
    # The counter sees all but runs of 15 and the ends of the recording.
    assert abs(found.frame_errors.counter.lost - (2000 - len(found))) <= 2
    assert found.frame_errors.counter.lost > 50


def frames_repeated(rig: DeviceRig) -> None:
    found = got(rig)
    assert found.frame_errors.counter.repeats == len(found) - len(np.unique(found.time_ns)) > 50


def frames_swapped(rig: DeviceRig) -> None:
    assert got(rig).frame_errors.counter.late > 50


def stream_stops(rig: DeviceRig) -> None:
    found = got(rig, 4.0)
    assert len(found) == pytest.approx(1000, abs=60)


def stuck_axis(rig: DeviceRig) -> None:
    spread = np.ptp(got(rig).xyz, axis=0)
    assert spread[1] == 0
    assert min(spread[0], spread[2]) > 1e-3


def thermometer_frozen(rig: DeviceRig) -> None:
    found = got(rig, 5.0)
    assert len(found.temperature_degC) >= 4
    assert np.ptp(found.temperature_degC[1:]) == 0


def clock_fast(rig: DeviceRig) -> None:
    assert len(got(rig, 2.0)) == pytest.approx(2000 * 1.02, abs=1)


def babble(rig: DeviceRig) -> None:
    rig.heard()
    rig.clock.sleep(1.0)
    assert len([1 for can_id, _ in rig.heard() if can_id == 0x001]) == pytest.approx(5000, abs=1)


def early(rig: DeviceRig) -> None:
    """What nobody has asked for yet is dropped, and the right answer taken."""
    assert rig.station.upload(0x1018, 1) == (0xCA1B0).to_bytes(4, "little")
    assert rig.station.upload(0x1018, 2) == (0xACC).to_bytes(4, "little")
    assert rig.station.sdo.dropped == 1


def other_id(rig: DeviceRig) -> None:
    with pytest.raises(DeviceSilent):
        rig.station.upload(0x1000, 0)
    assert [can_id for can_id, _ in rig.heard() if can_id & 0x780 == 0x580] == [0x580 + rig.node + 1]


def holds(rig: DeviceRig) -> None:
    assert rig.station.upload(0x1800, 5) == bytes(2)
    assert not len(got(rig, 0.5).readings)


def forgets(rig: DeviceRig) -> None:
    rig.station.download(0x2106, 0, b"\0")
    rig.station.download(0x1010, 1, b"save", 5.0)
    rig.station.nmt("reset-node")
    rig.station.wait_boot_up(1.0)
    assert rig.station.upload(0x2106, 0) == b"\1"


def remap(rig: DeviceRig) -> None:
    before = [rig.station.upload(0x1A00, sub) for sub in (3, 4)]
    rig.clock.sleep(2.0)
    assert [rig.station.upload(0x1A00, sub) for sub in (4, 3)] == before


def not_operational(rig: DeviceRig) -> None:
    assert not len(got(rig, 0.5).readings)
    rig.clock.sleep(1.1)
    assert rig.station.state() == "pre-operational"


def falls_back(rig: DeviceRig) -> None:
    assert len(got(rig, 2.0).readings) == pytest.approx(1000, abs=300)
    assert rig.station.state() == "pre-operational"


CASES: dict[str, Check] = {
    "early:at=1,times=1": early,
    "other-id:at=1,times=1": other_id,
    "holds:index=0x1800,sub=5,value=0": holds,
    "forgets:index=0x2106": forgets,
    "remap:after_s=1": remap,
    "not-operational": not_operational,
    "falls-back:after_s=1": falls_back,
    "deaf": deaf,
    "silent:index=0x2101,access=write": silent,
    "late:index=0x2101,sub=1,seconds=0.85": late,
    "stale": stale,
    "stale:at=5,times=1": stale_once,
    "wrong-object:index=0x2106,value=0x9999": wrong_object,
    "refuse:index=0x2106,access=write,code=0x08000022": refuse,
    "only-idle:index=0x2106": only_idle,
    "wrong-toggle": wrong_toggle,
    "lost-segment:index=0x2120,at=3": lost_segment,
    "lost-segment:index=0x2120,at=428": lost_segment,  # the last but one of all
    "twice": twice,
    "reads:index=0x2102,sub=1,value=0.25": reads,
    "reboot:at=2": reboot,
    "power-cut:at=3,seconds=1": power_cut,
    "power-cut": power_cut_for_good,
    "save-fails": save_fails,
    "save-lies": save_lies,
    "save-torn:seconds=0.5": save_torn,
    "other-unit:index=0x1018,sub=4,at=2,value=43": other_unit,
    "no-boot-up:at=2": no_boot_up,
    "heartbeat-stops:after_s=1": heartbeat_stops,
    "heartbeat-slow:seconds=2": heartbeat_slow,
    "emergency:code=0x4210,seconds=1": emergency,
    "emergency:code=0x8120,after_s=3": emergency_at,
    "spontaneous-reset:after_s=3": spontaneous_reset,
    "counter-stuck": counter_stuck,
    "status:value=1": status,
    "crc-errors:fraction=0.05": crc_errors,
    "frames-lost:fraction=0.05": frames_lost,
    "frames-repeated:fraction=0.05": frames_repeated,
    "frames-swapped:fraction=0.05": frames_swapped,
    "stream-stops:after_s=1": stream_stops,
    "stuck-axis:value=1": stuck_axis,
    "thermometer-frozen:after_s=1": thermometer_frozen,
    "clock-fast:fraction=0.02": clock_fast,
    "babble": babble,
}


def shaking(times_s: np.ndarray) -> np.ndarray:
    """A sensor that is not still, so that a stuck axis shows."""
    return np.stack([0.1 * np.sin(40 * times_s + axis) for axis in range(3)], axis=1)


@pytest.mark.parametrize("text", CASES)
def test_the_fault_is_seen_for_what_it_is(rig: Rig, text: str) -> None:
    CASES[text](rig(faults=[text], sense=shaking, temperature=lambda t: 20.0 + t, rate_hz=RATE))


def test_every_kind_has_a_case() -> None:
    assert {parse(text).kind for text in CASES} == set(KINDS)


def test_a_fault_elsewhere_does_nothing(rig: Rig) -> None:
    device = rig(faults=["refuse:index=0x2101,sub=7", "late:index=0x2102,seconds=9", "power-cut:at=1000"])
    assert device.station.identify().serial == 42
    assert device.station.upload(0x2101, 1) == ONE


def test_times_bounds_a_fault(rig: Rig) -> None:
    device = rig(faults=["refuse:index=0x2106,at=2,times=2,code=0x08000000"])
    outcomes = []
    for _ in range(5):
        try:
            outcomes.append(device.station.upload(0x2106, 0))
        except DeviceRefused as refusal:
            outcomes.append(refusal.code.to_bytes(4, "big"))
    assert outcomes == [b"\1", bytes.fromhex("08000000"), bytes.fromhex("08000000"), b"\1", b"\1"]


def test_text_form() -> None:
    assert parse("refuse:index=0x2101,sub=1,code=0x06090030,access=write") == InjectedFault(
        "refuse", index=0x2101, sub=1, code=0x06090030, access="write"
    )
    for text, printed in (
        ("silence", "There is no fault 'silence' (nearest: silent); the known ones are silent, deaf"),
        ("late:second=1", "'second=1' is not one of at, times"),
        ("late:seconds", "'seconds' is not one of"),
        ("late:seconds=long", "'long' is not a number for seconds"),
        ("refuse:access=both", "access is read or write"),
    ):
        with pytest.raises(UsageError) as caught:
            parse(text)
        assert printed in caught.value.sentence
