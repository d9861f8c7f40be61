"""Our SDO client and device map against a CANopen server that nobody here wrote, over the kernel's bus."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from vcan_harness.interface import Interface
from vcan_harness.node import NodeDevice
from vcan_harness.raw import RawSocket

from station.adapters.bus.socketcan import SocketCan
from station.adapters.clock import SystemClock
from station.adapters.device.canopen_device import CanopenDevice
from station.adapters.device.network import ServiceNetwork, service_ids
from station.config.products import load_product
from station.domain import writeback
from station.domain.types import Calibration
from station.errors import BusFault, DeviceRefused, DeviceSilent

NODE = 3
PRODUCT = load_product("accelerometer")
SILENT_S = 0.5

StartDevice = Callable[..., NodeDevice]


@pytest.fixture
def device(vcan: Interface) -> Iterator[CanopenDevice]:
    """Our view of the node on the interface; time-outs that a slow guest keeps."""
    bus = SocketCan(vcan.name)
    network = ServiceNetwork(bus.service(service_ids((NODE,))), SystemClock())
    yield CanopenDevice(network, NODE, answer_s=2.0)
    bus.close()


def _calibration(rng: np.random.Generator) -> Calibration:
    matrix = np.eye(3) + rng.uniform(-0.04, 0.04, (3, 3))
    nothing = np.zeros(0)
    return Calibration(
        method="six-point",
        unit="g",
        offset=rng.uniform(-0.05, 0.05, 3),
        matrix=matrix,
        covariance=np.zeros((12, 12)),
        positions=(),
        residual=np.zeros((0, 3)),
        tilt_deg=nothing,
        tilt_std_deg=nothing,
        disturbed=np.zeros(0, bool),
        residual_rms=0.0,
    )


def test_it_is_recognised_as_our_product(vcan: Interface, device: CanopenDevice, node_device: StartDevice) -> None:
    node_device(vcan, node=NODE, serial=42)
    found = device.identify()
    assert found.serial == 42
    assert (found.hardware, found.software) == ("Node", "canopen 6.2.1")
    wrong = PRODUCT.mismatches(
        device_type=found.device_type,
        vendor=found.vendor,
        product=found.product,
        revision=found.revision,
        name=found.name,
    )
    assert wrong == ()


def test_it_takes_a_calibration_bit_for_bit_and_keeps_it_over_a_reset(
    vcan: Interface, device: CanopenDevice, node_device: StartDevice, rng: np.random.Generator
) -> None:
    peer = node_device(vcan, node=NODE, flash_ms=300)
    calibration = _calibration(rng)
    writes = writeback.sequence(PRODUCT.map, calibration, record="0" * 36, temperature_degC=23.5, epoch_ns=10**18)
    kept = {write.address: write.raw for write in writes if write.read_back and write.name != "valid"}
    for write in writes:
        device.download(write.index, write.sub, write.raw)
    save = writeback.save(PRODUCT.map)
    device.download(save.index, save.sub, save.raw, timeout_s=5.0)
    peer.wait_for("saved")
    assert {at: device.upload(*at) for at in kept} == kept
    assert device.upload(0x2105, 0) == writeback.expected_checksum(PRODUCT.map, kept)

    device.nmt("reset-node")
    device.wait_boot_up(5.0)
    after = {at: device.upload(*at) for at in kept}
    assert after == kept
    assert device.upload(0x2107, 0) == b"\x01"
    offset, matrix = writeback.decode(PRODUCT.map, after)
    np.testing.assert_array_equal(offset, calibration.offset.astype(np.float32))
    np.testing.assert_array_equal(matrix, calibration.matrix.astype(np.float32))


def test_its_faults_end_in_the_right_error_and_the_next_transfer_is_sound(
    vcan: Interface, device: CanopenDevice, node_device: StartDevice
) -> None:
    peer = node_device(vcan, node=NODE)
    with pytest.raises(DeviceRefused) as refused:
        device.download(0x2102, 1, bytes(4))
    assert refused.value.code == 0x08000022  # locked
    peer.fault(silent=True)
    with pytest.raises(DeviceSilent):
        device.upload(0x1018, 4, timeout_s=SILENT_S)
    peer.fault(late_ms=int(1500 * SILENT_S))
    with pytest.raises(DeviceSilent):
        device.upload(0x1018, 4, timeout_s=SILENT_S)
    peer.fault()
    assert device.upload(0x1018, 3) == (0x10001).to_bytes(4, "little")


def test_answers_given_twice_are_told_from_fresh_ones(
    vcan: Interface, device: CanopenDevice, node_device: StartDevice, raw_socket: Callable[..., RawSocket]
) -> None:
    wire = raw_socket(vcan)
    peer = node_device(vcan, node=NODE, heartbeat_ms=0, serial=42)
    identity = {1: 0xCA1B0, 2: 0xACC, 3: 0x10001, 4: 42}

    def read(sub: int) -> int:
        """Reads one object, and lets the second answer come in as well."""
        value = int.from_bytes(device.upload(0x1018, sub), "little")
        answers = 0
        while answers < 2:
            answers += wire.receive()[0] == 0x580 + NODE
        return value

    peer.fault(twice=True)
    assert [read(1), read(2)] == [identity[1], identity[2]]
    with pytest.raises(BusFault, match="two devices share this node id"):
        read(3)
