"""Devices in real time: one channel shared by several, the world's commands, and what cannot be asked for."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from station.adapters.canopen import eds
from station.adapters.clock import SystemClock
from station.adapters.simulated_device.device import SimulatedDevice, Timing
from station.adapters.simulated_device.live import Hub, serve
from station.adapters.simulated_device.stream import SimulatedSensor
from station.cli._device import parse_node_id
from station.domain.core.types import Frames
from station.errors import ConfigError, StationError, UsageError
from station.wiring.live_device import LiveDevices, Population, TrueErrors, World
from tests.fakes.device_rig import DBC, DeviceRig, still
from tests.fakes.loop_channel import LoopChannel


def test_two_devices_share_one_channel_in_real_time(rig: Callable[..., DeviceRig]) -> None:
    pattern = rig()
    near, far = LoopChannel.pair()
    hub, clock, end = Hub(far), SystemClock(), threading.Event()
    devices = [
        SimulatedDevice(
            hub.endpoint(),
            clock,
            eds.load(DBC / "accelerometer.eds", node),
            pattern.product.map,
            SimulatedSensor(pattern.layout, still(), lambda _: 25.0),
            serial=node,
            timing=Timing(turnaround_s=0.0, block_s=0.0),
        )
        for node in (5, 6)
    ]
    thread = threading.Thread(target=serve, args=(hub, devices, clock, lambda: not end.is_set()))
    thread.start()
    try:
        for node in (5, 6):
            near.send(0x600 + node, bytes.fromhex("40 18 10 04 00 00 00 00"))
            answer = near.wait_for(0x580 + node)
            assert answer == bytes.fromhex("43 18 10 04") + node.to_bytes(4, "little")
        near.send(0x000, bytes([0x01, 0]))
        first, second = near.wait_for(0x185), near.wait_for(0x185)
        # The low nibble is the counter; the high one is the status, which may change between two frames.
        assert ((second[1] & 0x0F) - (first[1] & 0x0F)) % 15 == 1
    finally:
        end.set()
        thread.join(10)
    assert not thread.is_alive()


def test_the_world_obeys() -> None:
    world = World()
    world.obey("up -x")
    np.testing.assert_array_equal(world.true, [-1, 0, 0])
    world.obey("true 0.6 0 0.8")
    world.obey("temperature -4.5")
    np.testing.assert_array_equal(world.true, [0.6, 0, 0.8])
    assert world.temperature_degC == -4.5


@pytest.mark.parametrize("line", ["up", "up w", "true 1 2", "true a b c", "temperature", "temperature hot", "fly", ""])
def test_a_command_that_is_none_changes_nothing(line: str) -> None:
    world = World()
    with pytest.raises(UsageError, match="is not a command; write up"):
        world.obey(line)
    np.testing.assert_array_equal(world.true, [0, 0, 1])


def test_a_unit_senses_by_the_stations_model() -> None:
    world, body = World(), TrueErrors(np.diag([1.0, 1.0, 1.1]), np.array([0.1, 0.0, 0.0]), 0.0)
    np.testing.assert_allclose(body.sensed(world, np.random.default_rng(1))(np.zeros(2)), [[0.1, 0, 1.1]] * 2)


@pytest.mark.parametrize(
    ("changes", "printed"),
    [
        ({"serials": ("SN1", "SN2")}, "1 node but 2 serials"),
        ({"nodes": (128,)}, "Node 128"),
        ({"nodes": (5, 5), "serials": ("SN1", "SN2")}, "used twice"),
        ({"product": "toaster"}, "toaster.yaml"),
    ],
)
def test_what_cannot_be_asked_for_is_told(changes: dict[str, Any], printed: str) -> None:
    wanted: dict[str, Any] = {"product": "accelerometer", "channel": "nocan9", "nodes": (5,), "serials": ("SN1",)}
    with pytest.raises(StationError) as caught:
        LiveDevices.open(Population(**{**wanted, **changes}))
    assert printed in caught.value.sentence


def test_an_interface_that_is_not_there_is_told() -> None:
    with pytest.raises(ConfigError):
        LiveDevices.open(Population("accelerometer", "nocan9", (5,), ("SN1",)))


def test_node_ids_as_people_write_them() -> None:
    assert (parse_node_id("17"), parse_node_id("0x11")) == (17, 17)
    with pytest.raises(UsageError, match="write 1 to 127"):
        parse_node_id("eleven")


def test_frames_are_not_lost_between_the_taps() -> None:
    near, far = LoopChannel.pair()
    hub = Hub(far)
    one, other = hub.endpoint(), hub.endpoint()
    for i in range(3):
        near.send(i, bytes([i]))
        hub.wait(0.1)
    ids: list[Frames] = [one.receive(0.0), other.receive(0.0)]
    assert [frames.can_id.tolist() for frames in ids] == [[0, 1, 2], [0, 1, 2]]
    assert len(one.receive(0.0)) == 0


def test_an_interface_that_only_reads_carries_no_device(tmp_path: Path) -> None:
    recorded = tmp_path / "drive.log"
    recorded.write_text("(1767225600.000000) can0 185#0001000000000000\n")
    wanted = Population("accelerometer", str(recorded), (5,), ("SN0001",), interface="replay")
    with pytest.raises(ConfigError, match="Interface replay only reads"):
        LiveDevices.open(wanted)


def test_a_bus_that_cannot_be_named_so_is_a_sentence() -> None:
    with pytest.raises(UsageError, match="interface"):
        LiveDevices.open(Population("accelerometer", "can0", (5,), ("SN0001",), interface="!?"))
