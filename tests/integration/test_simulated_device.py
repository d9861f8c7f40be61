"""The simulated device's life: flash, power, NMT, heartbeat, readings, compensation, as the station sees them."""

import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from station.adapters.simulated_device.device import Timing
from station.adapters.simulated_device.nonvolatile import NonVolatileMemory
from station.domain.can import encode
from station.domain.can.decode import Samples, decode_samples
from station.domain.core.types import Calibration
from station.domain.product import writeback
from station.errors import ConfigError, DeviceRefused, DeviceSilent, UsageError
from tests.fakes.device_rig import DeviceRig, still

Rig = Callable[..., DeviceRig]

A = np.array([[1.01, 0.002, 0.0], [0.001, 0.99, -0.001], [0.0, 0.003, 1.0]])
B = np.array([0.012, -0.003, 0.021])
CALIBRATION = Calibration(
    method="six-point",
    unit="g",
    offset=B,
    matrix=A,
    covariance=np.zeros((12, 12)),
    positions=(),
    residual=np.zeros((0, 3)),
    tilt_deg=np.zeros(0),
    tilt_std_deg=np.zeros(0),
    disturbed=np.zeros(0, bool),
    residual_rms=0.0,
)


def write(rig: DeviceRig) -> dict[tuple[int, int], bytes]:
    """Writes the calibration as the station does, reading each object back; what was written."""
    writes = writeback.sequence(
        rig.product.map, CALIBRATION, record="r-1", temperature_degC=23.5, epoch_ns=rig.clock.epoch_ns()
    )
    for each in writes:
        rig.station.download(*each.address, each.raw, each.timeout_s)
        if each.read_back:
            assert rig.station.upload(*each.address) == each.raw
    return {each.address: each.raw for each in writes if each.read_back}


def save(rig: DeviceRig) -> None:
    command = writeback.save(rig.product.map)
    assert command is not None
    rig.station.download(*command.address, command.raw, command.timeout_s)


def restart(rig: DeviceRig) -> None:
    rig.station.nmt("reset-node")
    rig.station.wait_boot_up(1.0)


def held(rig: DeviceRig, addresses: dict[tuple[int, int], bytes]) -> dict[tuple[int, int], bytes]:
    return {address: rig.station.upload(*address) for address in addresses}


def decoded(rig: DeviceRig, duration_s: float) -> Samples:
    return decode_samples(rig.readings(duration_s), rig.layout, rig.node)


def steps(rig: DeviceRig, got: Samples) -> list[list[int]]:
    """Readings as the integers that were sent."""
    counts: list[list[int]] = np.rint(got.xyz / [axis.scale for axis in rig.layout.axes]).astype(int).tolist()
    return counts


# ---- identity, flash, power ----


def test_it_names_itself(rig: Rig) -> None:
    identity = rig().station.identify()
    assert (identity.device_type, identity.vendor, identity.product, identity.revision) == (
        0x20194,
        0xCA1B0,
        0xACC,
        0x10000,
    )
    assert (identity.serial, identity.name, identity.hardware, identity.software) == (
        42,
        "accelerometer",
        "A1",
        "1.0.0",
    )


def test_what_is_saved_outlives_the_reset_what_is_not_does_not(rig: Rig) -> None:
    device = rig()
    factory = {n.address: device.station.upload(*n.address) for _, n in device.product.map.coefficients()}
    written = write(device)
    restart(device)
    assert held(device, factory) == factory
    written = write(device)
    save(device)
    restart(device)
    assert held(device, written) == written
    assert device.station.upload(0x2105, 0) == writeback.expected_checksum(device.product.map, written)
    offset, matrix = writeback.decode(device.product.map, held(device, factory))
    np.testing.assert_allclose(offset, B, atol=1e-8)
    np.testing.assert_allclose(matrix, A, atol=1e-7)


def test_the_answer_to_save_comes_after_storing(rig: Rig) -> None:
    device = rig(timing=Timing(flash_s=2.0), answer_s=0.5)
    write(device)
    began_s = device.clock.monotonic_s()
    save(device)
    assert device.clock.monotonic_s() - began_s == pytest.approx(2.001)
    assert device.memory.objects()["2107:00"] == 1


def test_a_reset_in_the_middle_of_saving_keeps_the_old_values(rig: Rig) -> None:
    device = rig(timing=Timing(flash_s=2.0))
    write(device)
    with pytest.raises(DeviceSilent):
        device.station.download(0x1010, 1, b"save", 1.0)
    restart(device)
    assert device.memory.objects() == {}
    assert device.station.upload(0x2107, 0) == b"\0"


def test_restore_takes_effect_at_the_reset(rig: Rig) -> None:
    device = rig()
    written = write(device)
    save(device)
    device.station.download(0x1011, 1, b"load")
    assert held(device, written) == written
    restart(device)
    assert device.station.upload(0x2101, 1) == struct.pack("<f", 1.0)
    assert device.memory.objects() == {}


def test_the_memory_is_a_file_that_the_next_process_reads(rig: Rig, tmp_path: Path) -> None:
    device = rig(memory=NonVolatileMemory.of_serial(tmp_path, "SN0042"))
    written = write(device)
    assert not (tmp_path / "SN0042.json").exists()  # nothing was saved yet
    save(device)
    objects = json.loads((tmp_path / "SN0042.json").read_text())["objects"]
    assert objects["2101:01"] == struct.unpack("<f", struct.pack("<f", 1.01))[0]
    assert (objects["2107:00"], objects["2100:00"]) == (1, "r-1")
    assert [p.name for p in tmp_path.iterdir()] == ["SN0042.json"]
    again = rig(memory=NonVolatileMemory.of_serial(tmp_path, "SN0042"))
    assert held(again, written) == written


def test_a_damaged_memory_file_and_a_hostile_serial_get_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "SN1.json").write_text("{")
    with pytest.raises(ConfigError, match="delete it to start afresh"):
        NonVolatileMemory.of_serial(tmp_path, "SN1")
    for serial in ("../x", "a/b", "", ".hidden", "a\0b"):
        with pytest.raises(UsageError, match="cannot name a file"):
            NonVolatileMemory.of_serial(tmp_path, serial)


def test_a_power_cut_loses_what_was_not_saved(rig: Rig) -> None:
    device = rig()
    written = write(device)
    device.device.cut_power(0.5)
    with pytest.raises(DeviceSilent):
        device.station.upload(0x2107, 0, 0.3)
    device.clock.sleep(1.0)
    assert held(device, written) != written
    assert device.station.boot_ups() == 2


# ---- life cycle ----


def test_boot_up_heartbeat_and_nmt_states(rig: Rig) -> None:
    device = rig()
    device.clock.sleep(0.01)
    assert (device.station.state(), device.station.boot_ups()) == ("booting", 1)
    device.clock.sleep(0.6)
    assert device.station.state() == "pre-operational"
    for command, state in (("start", "operational"), ("stop", "stopped"), ("pre-operational", "pre-operational")):
        device.station.nmt(command)
        device.clock.sleep(0.6)
        assert device.station.state() == state
    device.clock.sleep(0.1)
    assert 0.0 <= device.station.heartbeat_age_s() <= 0.5
    device.station.nmt("reset-communication")
    device.station.wait_boot_up(1.0)
    assert device.station.boot_ups() == 2


def test_the_heartbeat_follows_its_object(rig: Rig) -> None:
    device = rig()
    device.station.download(0x1017, 0, (100).to_bytes(2, "little"))
    device.heard()
    device.clock.sleep(1.0)
    assert len([1 for can_id, _ in device.heard() if can_id == 0x705]) == 10
    device.station.download(0x1017, 0, bytes(2))
    device.heard()
    device.clock.sleep(1.0)
    assert [can_id for can_id, _ in device.heard()] == []


def test_a_reset_of_communication_keeps_the_application(rig: Rig) -> None:
    device = rig()
    device.unlock()
    device.station.download(0x2102, 1, struct.pack("<f", 0.1))
    device.station.download(0x1017, 0, bytes(2))
    device.station.nmt("reset-communication")
    device.station.wait_boot_up(1.0)
    assert device.station.upload(0x2102, 1) == struct.pack("<f", 0.1)
    assert device.station.upload(0x1017, 0) == (500).to_bytes(2, "little")


def test_waiting_for_a_boot_up_that_came_before_the_call(rig: Rig) -> None:
    device = rig()
    device.station.nmt("reset-node")
    device.clock.sleep(1.0)
    device.station.wait_boot_up(0.1)


def test_an_unknown_nmt_command_is_refused(rig: Rig) -> None:
    with pytest.raises(UsageError, match="use one of start, stop"):
        rig().station.nmt("explode")


def test_emcy_of_any_length_is_kept(rig: Rig) -> None:
    device = rig()
    for data in (bytes.fromhex("10 81 11 01 02 03 04 05"), bytes.fromhex("30 81"), b"", bytes.fromhex("00 10 01")):
        device.raw.send(0x085, data)
    got = device.station.emergencies()
    assert [(e.code, e.register, e.detail) for e in got] == [
        (0x8110, 0x11, bytes([1, 2, 3, 4, 5])),
        (0x8130, 0, b""),
        (0, 0, b""),
        (0x1000, 1, b""),
    ]
    assert device.station.emergencies() == ()


# ---- readings ----


@pytest.mark.parametrize("rate_hz", [None, 100.0, 400.0, 1000.0])
def test_readings_come_at_the_rate_counted_and_protected(rig: Rig, rate_hz: float | None) -> None:
    device = rig(rate_hz=rate_hz)
    assert len(device.readings(0.5)) == 0  # not before it is operational
    device.station.nmt("start")
    got = decoded(device, 2.0)
    assert len(got) == pytest.approx(2.0 * (rate_hz or 100.0), abs=1)
    assert got.frame_errors.clean, got.frame_errors
    period_ns = 1e9 / (rate_hz or 100.0)
    assert np.all(np.abs(np.diff(got.time_ns) - period_ns) <= 1)
    assert got.temperature_degC.tolist() == [23.5, 23.5] or got.temperature_degC.tolist() == [23.5]


def test_readings_are_quantised_and_clipped_as_a_converter_does(rig: Rig) -> None:
    device = rig(sense=still((1e-5, 2.5, -9.0)))
    device.station.nmt("start")
    got = decoded(device, 0.5)
    assert steps(device, got)[0] == [0, 32767, -32768]
    assert set((np.asarray(got.status) & 2).tolist()) == {2}
    assert int(np.asarray(got.status)[-1]) & 8 == 0


def test_status_says_that_it_has_not_settled_since_power_on(rig: Rig) -> None:
    device = rig(timing=Timing(warm_up_s=1.0))
    device.station.nmt("start")
    got = decoded(device, 2.0)
    unsettled = (np.asarray(got.status) & 8) != 0
    assert unsettled[0]
    assert not unsettled[-1]
    assert 95 <= unsettled.sum() <= 100


def test_output_is_raw_or_compensated_as_the_switch_says(rig: Rig) -> None:
    truth = np.array([0.3, -0.5, 0.8])
    device = rig(sense=still(A @ truth + B))
    write(device)
    device.station.nmt("start")
    step = device.layout.axes[0].scale
    compensated = decoded(device, 0.1)
    # The converter rounds by up to half a step on each axis, the output by half a step more.
    bound = step * (0.5 * np.abs(np.linalg.inv(A)).sum(axis=1) + 0.5) + 1e-7
    assert np.all(np.abs(compensated.xyz - truth) <= bound)
    assert set((np.asarray(compensated.status) & 4).tolist()) == {4}
    switch = writeback.output(device.product.map, raw=True)
    assert switch is not None
    device.station.download(*switch.address, switch.raw)
    raw = decoded(device, 0.1)
    assert steps(device, raw)[-1] == [
        int(encode.to_raw(v, a)) for v, a in zip(A @ truth + B, device.layout.axes, strict=True)
    ]
    assert int(np.asarray(raw.status)[-1]) & 4 == 0


def test_an_invalid_calibration_is_not_used(rig: Rig) -> None:
    device = rig(sense=still((0.5, 0.0, 0.0)))
    write(device)
    device.station.download(0x2107, 0, b"\0")
    device.station.nmt("start")
    assert set((np.asarray(decoded(device, 0.1).status) & 4).tolist()) == {0}


def test_measured_objects_agree_with_the_stream(rig: Rig) -> None:
    truth = np.array([0.3, -0.5, 0.8])
    device = rig(sense=still(A @ truth + B), temperature=lambda _: -12.34)
    write(device)
    device.station.nmt("start")
    got = decoded(device, 0.1)
    read = [struct.unpack("<h", device.station.upload(0x2111, axis))[0] for axis in (1, 2, 3)]
    sent = [struct.unpack("<h", device.station.upload(0x2113, axis))[0] for axis in (3, 4, 5)]
    assert read == sent == steps(device, got)[-1]
    assert struct.unpack("<h", device.station.upload(0x2112, 0)) == (-1234,)
    raw = [struct.unpack("<h", device.station.upload(0x2110, axis))[0] for axis in (1, 2, 3)]
    assert np.all(np.abs(np.array(raw) * device.layout.axes[0].scale - (A @ truth + B)) <= 0.5 * 6.25e-5 + 1e-12)


def test_readings_on_sync(rig: Rig) -> None:
    device = rig()
    device.station.download(0x1800, 2, b"\x02")  # every second SYNC
    device.station.nmt("start")
    device.clock.settle()
    device.stream.receive(0.0)
    for _ in range(10):
        device.raw.send(0x080, b"")
        device.clock.sleep(0.005)
    got = decode_samples(device.stream.receive(0.0), device.layout, device.node)
    assert len(got) == 5
    assert got.frame_errors.clean


def test_a_pdo_is_switched_off_by_its_cob_id_and_paced_by_its_timer(rig: Rig) -> None:
    device = rig()
    device.station.nmt("start")
    device.station.download(0x1800, 5, (2).to_bytes(2, "little"))
    assert len(decoded(device, 1.0)) == pytest.approx(500, abs=1)
    device.station.download(0x1800, 1, (0x80000185).to_bytes(4, "little"))
    assert len(decoded(device, 1.0)) == 0


def test_the_same_world_gives_the_same_frames(rig: Rig) -> None:
    def run() -> bytes:
        device = rig(rate_hz=1000.0, sense=lambda t: np.stack([np.sin(7 * t), np.cos(5 * t), t % 1], axis=1))
        device.station.nmt("start")
        frames = device.readings(1.0)
        return frames.time_ns.tobytes() + frames.data.tobytes()

    assert run() == run()


def test_no_answer_to_a_read_of_what_is_write_only(rig: Rig) -> None:
    with pytest.raises(DeviceRefused, match="the object is write-only"):
        rig().station.upload(0x2104, 0)
