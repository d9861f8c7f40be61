"""What tests on vcan use; README.md lists it."""

import itertools
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from vcan_harness import programs
from vcan_harness.interface import Interface, Link, create_link, create_vcan
from vcan_harness.node import NodeDevice, NodeMaster
from vcan_harness.programs import Candump
from vcan_harness.raw import RawSocket

_number = itertools.count()


@pytest.fixture
def new_vcan() -> Iterator[Callable[[], Interface]]:
    """Makes vcan interfaces with names never used before; they go when the test ends."""
    with ExitStack() as stack:

        def create() -> Interface:
            interface = create_vcan(f"vcan{next(_number)}")
            stack.callback(interface.delete)
            return interface

        yield create


@pytest.fixture
def vcan(new_vcan: Callable[[], Interface]) -> Interface:
    """A fresh vcan, up."""
    return new_vcan()


@pytest.fixture
def shaped_vcan() -> Iterator[Callable[[int], Link]]:
    """Makes a bus of a given bit rate: the station's end `near`, the devices' end `far`."""
    with ExitStack() as stack:

        def create(bitrate: int) -> Link:
            link = create_link(f"near{next(_number)}", f"far{next(_number)}", bitrate)
            stack.callback(link.near.delete)
            return link

        yield create


@pytest.fixture
def raw_socket() -> Iterator[Callable[..., RawSocket]]:
    """Opens bare CAN sockets: raw_socket(interface, buffer_bytes=None)."""
    with ExitStack() as stack:

        def create(interface: Interface, buffer_bytes: int | None = None) -> RawSocket:
            return stack.enter_context(RawSocket(interface.name, buffer_bytes))

        yield create


@pytest.fixture
def candump(tmp_path: Path) -> Iterator[Callable[[Interface], Candump]]:
    """Starts candump on an interface; it is listening when the call returns."""
    with ExitStack() as stack:

        def start(interface: Interface) -> Candump:
            running = Candump(interface, tmp_path / f"candump-{interface.name}.log")
            stack.callback(running.stop)
            return running

        yield start


@pytest.fixture
def canplayer() -> Callable[..., None]:
    """Plays a candump log: canplayer(log, {"name in the log": "interface"}, *options)."""
    return programs.canplayer


@pytest.fixture
def cansend() -> Callable[[Interface, int, bytes], None]:
    """Sends one frame by cansend, error frames included."""
    return programs.cansend


@pytest.fixture
def cangen() -> Iterator[Callable[..., "subprocess.Popen[str]"]]:
    """Starts cangen: cangen(interface, *options)."""
    with ExitStack() as stack:

        def start(interface: Interface, *options: str) -> "subprocess.Popen[str]":
            running = stack.enter_context(programs.start_cangen(interface, *options))
            stack.callback(running.kill)
            return running

        yield start


@pytest.fixture
def node_device() -> Iterator[Callable[..., NodeDevice]]:
    """Starts the independent device: node_device(interface, node=1, **options)."""
    with ExitStack() as stack:

        def start(interface: Interface, **options: Any) -> NodeDevice:
            return stack.enter_context(NodeDevice(interface, **options))

        yield start


@pytest.fixture
def node_master() -> Iterator[Callable[[Interface], NodeMaster]]:
    """Starts the independent master on an interface."""
    with ExitStack() as stack:

        def start(interface: Interface) -> NodeMaster:
            return stack.enter_context(NodeMaster(interface))

        yield start
