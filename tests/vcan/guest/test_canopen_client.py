"""The station's CANopen against a device that nobody here wrote: the npm package canopen on a real vcan."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from vcan_harness.interface import Interface
from vcan_harness.node import NodeDevice
from vcan_harness.programs import Candump
from vcan_harness.raw import RawSocket

from station.adapters.bus.socketcan import SocketCan
from station.adapters.canopen.canopen_device import CanopenDevice
from station.adapters.canopen.network import ServiceNetwork, service_ids
from station.adapters.clock import SystemClock
from station.adapters.dbc import read_layouts
from station.config.products import load_product
from station.domain.can.decode import decode_samples
from station.domain.can.sensor_layout import resolve
from station.domain.core.types import Calibration, Frames
from station.domain.product import writeback
from station.errors import BusFault, DeviceRefused, DeviceSilent

NODE = 5
DBC = Path(__file__).parents[3] / "dbc" / "accelerometer.dbc"
MATRIX = np.array([[1.01, 0.002, 0.0], [0.001, 0.99, -0.001], [0.0, 0.003, 1.0]])
OFFSET = np.array([0.012, -0.003, 0.021])
SETTLE_S = 20.0

Device = Callable[..., NodeDevice]
Station = Callable[[Interface], CanopenDevice]


def calibration() -> Calibration:
    return Calibration(
        method="six-point",
        unit="g",
        offset=OFFSET,
        matrix=MATRIX,
        covariance=np.zeros((12, 12)),
        positions=(),
        residual=np.zeros((0, 3)),
        tilt_deg=np.zeros(0),
        tilt_std_deg=np.zeros(0),
        disturbed=np.zeros(0, bool),
        residual_rms=0.0,
    )


@pytest.fixture
def station() -> Iterator[Station]:
    """The station's device on an interface, with time-outs for a slow guest."""
    with ExitStack() as stack:

        def make(interface: Interface) -> CanopenDevice:
            bus = SocketCan(interface.name)
            stack.callback(bus.close)
            network = ServiceNetwork(bus.service(service_ids((NODE,))), SystemClock())
            return CanopenDevice(network, NODE, answer_s=3.0)

        yield make


def write(device: CanopenDevice) -> dict[tuple[int, int], bytes]:
    """Writes and reads back everything, as the station does; what was written."""
    product = load_product("accelerometer")
    writes = writeback.sequence(product.map, calibration(), record="r-1", temperature_degC=23.5, epoch_ns=10**18)
    for each in writes:
        device.download(*each.address, each.raw)
        if each.read_back:
            assert device.upload(*each.address) == each.raw, each.name
    return {each.address: each.raw for each in writes if each.read_back}


def test_identify_write_save_reset_read_back(vcan: Interface, node_device: Device, station: Station) -> None:
    product = load_product("accelerometer")
    node_device(vcan, node=NODE, serial=42, vendor=0xCA1B0, product=0xACC, revision=0x10000, name="accelerometer")
    device = station(vcan)
    identity = device.identify()
    assert (identity.vendor, identity.product, identity.serial, identity.name) == (0xCA1B0, 0xACC, 42, "accelerometer")
    written = write(device)
    assert device.upload(0x2105, 0) == writeback.expected_checksum(product.map, written)
    save = writeback.save(product.map)
    assert save is not None
    device.download(*save.address, save.raw, SETTLE_S)
    device.nmt("reset-node")
    device.wait_boot_up(SETTLE_S)
    assert {at: device.upload(*at) for at in written} == written
    assert device.sdo.dropped == 0


def test_its_own_corrected_output_agrees_with_the_truth(vcan: Interface, node_device: Device, station: Station) -> None:
    product = load_product("accelerometer")
    layout = resolve(product.frames, read_layouts(DBC))
    unit = node_device(vcan, node=NODE, noise_g=0.0, matrix=MATRIX.ravel().tolist(), offset_g=OFFSET.tolist())
    truth = np.array([0.6, -0.48, 0.64])
    unit.turn(truth.tolist())
    device = station(vcan)
    write(device)
    bus = SocketCan(vcan.name)
    stream = bus.stream(layout.ids(NODE))
    device.nmt("start")
    frames = Frames.join([stream.receive(2.0) for _ in range(5)])
    got = decode_samples(frames, layout, NODE)
    bus.close()
    assert len(got) > 3
    assert got.frame_errors.crc_errors == 0
    # Half a step of the converter through the inverse matrix, and half a step of the output.
    bound = layout.axes[0].scale * (0.5 * np.abs(np.linalg.inv(MATRIX)).sum(axis=1) + 0.5) + 1e-6
    assert np.all(np.abs(got.xyz - truth) <= bound), got.xyz - truth


def test_long_values_in_segments_and_in_blocks(vcan: Interface, node_device: Device, station: Station) -> None:
    node_device(vcan, node=NODE)
    device = station(vcan)
    for length in (5, 7, 8, 200, 401, 1000):
        data = bytes((7 * i + length) % 256 for i in range(length))
        device.download(0x2120, 0, data)
        assert device.upload(0x2120, 0) == data


def test_what_candump_saw_is_what_the_client_did(
    vcan: Interface, node_device: Device, station: Station, candump: Callable[[Interface], Candump]
) -> None:
    node_device(vcan, node=NODE, heartbeat_ms=0)
    device = station(vcan)
    wire = candump(vcan)
    device.download(0x2104, 0, bytes.fromhex("3143414c"))
    device.download(0x2102, 3, bytes.fromhex("cdcccc3d"))
    assert device.upload(0x2102, 3) == bytes.fromhex("cdcccc3d")
    wire.wait_for(6)
    sdo = [(frame.can_id, frame.data.hex()) for frame in wire.frames() if frame.can_id in (0x585, 0x605)]
    assert sdo == [
        (0x605, "230421003143414c"),
        (0x585, "6004210000000000"),
        (0x605, "23022103cdcccc3d"),
        (0x585, "6002210300000000"),
        (0x605, "4002210300000000"),
        (0x585, "42022103cdcccc3d"),  # its way to send four bytes: size not said
    ]


def test_refusals_come_as_sentences(vcan: Interface, node_device: Device, station: Station) -> None:
    unit = node_device(vcan, node=NODE)
    device = station(vcan)
    with pytest.raises(DeviceRefused, match="the device's present state forbids it"):
        device.download(0x2102, 1, bytes(4))
    with pytest.raises(DeviceRefused, match="the object does not exist"):
        device.upload(0x2999, 0)
    unit.fault(refuse={0x2102: 0x06090030})
    with pytest.raises(DeviceRefused, match="the value is out of range"):
        device.download(0x2102, 1, bytes(4))


def test_a_late_confirmation_is_not_taken_for_another_ones(
    vcan: Interface, node_device: Device, station: Station
) -> None:
    unit = node_device(vcan, node=NODE)
    device = station(vcan)
    device.download(0x2104, 0, bytes.fromhex("3143414c"))
    unit.fault(late_ms=1500)
    with pytest.raises(DeviceSilent):
        device.download(0x2102, 1, bytes.fromhex("cdcccc3d"), 0.2)
    unit.fault(refuse={0x2102: 0x06090030})
    with pytest.raises(DeviceRefused) as caught:
        device.download(0x2102, 2, bytes.fromhex("cdcccc3d"))
    assert caught.value.code == 0x06090030


def test_a_silent_device_and_two_on_one_node_id_are_told_apart(
    vcan: Interface, node_device: Device, station: Station, raw_socket: Callable[..., RawSocket]
) -> None:
    unit = node_device(vcan, node=NODE, heartbeat_ms=0, serial=42)
    device, wire = station(vcan), raw_socket(vcan)

    def read(sub: int) -> int:
        """Reads one number of the identity, and lets the second answer come in as well."""
        value = int.from_bytes(device.upload(0x1018, sub), "little")
        answers = 0
        while answers < 2:
            answers += wire.receive()[0] == 0x580 + NODE
        return value

    unit.fault(silent=True)
    with pytest.raises(DeviceSilent):
        device.upload(0x1018, 4, 0.5)
    unit.fault(twice=True)
    assert read(2) == 0xACC
    with pytest.raises(BusFault, match="two devices share this node id"):
        for sub in (4, 3):
            read(sub)
    # The suspicion stays: whoever answers now may be the other one.
    with pytest.raises(BusFault, match="two devices share this node id"):
        device.upload(0x1018, 3)


def test_a_reset_that_nobody_ordered_is_seen(vcan: Interface, node_device: Device, station: Station) -> None:
    unit = node_device(vcan, node=NODE, heartbeat_ms=200)
    device = station(vcan)
    assert device.identify().serial >= 0
    before = device.boot_ups()
    unit.reboot()
    unit.wait_for("boot-up")
    assert device.identify().serial >= 0
    assert device.boot_ups() == before + 1
    assert device.heartbeat_age_s() < SETTLE_S
