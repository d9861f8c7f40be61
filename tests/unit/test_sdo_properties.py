"""SDO client against SDO server without a bus: whatever is lost on the way, no wrong value is taken for right."""

import random
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from station.adapters.canopen import eds, sdo_block, sdo_transfer
from station.adapters.canopen.network import ServiceNetwork
from station.adapters.canopen.sdo_client import SdoClient
from station.adapters.canopen.sdo_transfer import Exchange, NoAnswer, Refused, Violation
from station.adapters.simulated_device.sdo_server import SdoServer
from station.errors import BusFault, DeviceRefused, DeviceSilent, ProductError
from tests.fakes.scripted_channel import ScriptedChannel
from tests.portion import examples

INDEX, SUB = 0x2120, 0
EDS = Path(__file__).parents[2] / "dbc" / "accelerometer.eds"


class OneObject:
    """Objects of a server that has one, of any length."""

    def __init__(self, data: bytes) -> None:
        self.data = data

    def read(self, index: int, sub: int) -> bytes:
        """The bytes."""
        return self.data

    def check(self, index: int, sub: int, size: int | None) -> None:
        """Any size."""

    def write(self, index: int, sub: int, data: bytes) -> None:
        """New bytes."""
        self.data = data


def drive(transfer: Generator[Exchange, bytes, Any], server: SdoServer, lost: Callable[[], bool]) -> Any:
    """Runs a transfer as the client does, over a link that loses frames; what it returned, or the exception's type."""
    inbox: list[bytes] = []
    try:
        exchange = next(transfer)
        while True:
            for request in exchange.send:
                if not lost():
                    inbox += [answer for answer in server.handle(request) if not lost()]
            if exchange.fits is None:
                exchange = transfer.send(b"")
                continue
            answer = None
            while inbox and answer is None:
                frame = inbox.pop(0)
                if frame[0] == 0x80:
                    raise Refused(int.from_bytes(frame[4:], "little"))
                answer = frame if exchange.fits(frame) else None
            exchange = transfer.throw(NoAnswer()) if answer is None else transfer.send(answer)
            if exchange.send:
                inbox.clear()
    except StopIteration as done:
        return done.value
    except (NoAnswer, Refused, Violation) as failure:
        return type(failure)


def losing(seed: int, fraction: float) -> Callable[[], bool]:
    draw = random.Random(seed)
    return lambda: draw.random() < fraction


DATA = st.binary(min_size=0, max_size=3000)
DOWNLOADS = [sdo_transfer.download, sdo_block.download]


@given(data=DATA)
def test_every_value_is_read_as_it_is(data: bytes) -> None:
    assert drive(sdo_transfer.upload(INDEX, SUB), SdoServer(OneObject(data)), lambda: False) == data


@given(data=DATA.filter(bool), download=st.sampled_from(DOWNLOADS))
def test_every_value_is_written_as_it_is(data: bytes, download: Any) -> None:
    objects = OneObject(b"old")
    assert drive(download(INDEX, SUB, data), SdoServer(objects), lambda: False) is None
    assert objects.data == data


def test_an_empty_value_is_written_in_a_segment() -> None:
    objects = OneObject(b"old")
    assert drive(sdo_transfer.download(INDEX, SUB, b""), SdoServer(objects), lambda: False) is None
    assert objects.data == b""


@settings(max_examples=examples(300))
@given(data=DATA, seed=st.integers(0, 2**32), fraction=st.floats(0, 0.1))
def test_over_a_link_that_loses_a_read_is_right_or_fails(data: bytes, seed: int, fraction: float) -> None:
    got = drive(sdo_transfer.upload(INDEX, SUB), SdoServer(OneObject(data)), losing(seed, fraction))
    assert got == data or got in (NoAnswer, Refused, Violation)


@settings(max_examples=examples(300))
@given(
    data=DATA.filter(bool), download=st.sampled_from(DOWNLOADS), seed=st.integers(0, 2**32), fraction=st.floats(0, 0.1)
)
def test_over_a_link_that_loses_a_confirmed_write_is_right(
    data: bytes, download: Any, seed: int, fraction: float
) -> None:
    objects = OneObject(b"old")
    result = drive(download(INDEX, SUB, data), SdoServer(objects), losing(seed, fraction))
    assert objects.data in (b"old", data)  # never a part of it
    if result is None:
        assert objects.data == data


@given(requests=st.lists(st.binary(min_size=8, max_size=8), max_size=60), data=st.binary(max_size=40))
def test_no_request_upsets_the_server(requests: list[bytes], data: bytes) -> None:
    server = SdoServer(OneObject(data))
    for request in requests:
        answers = server.handle(request)
        assert len(answers) <= 127
        assert all(len(answer) == 8 for answer in answers)


FRAME = st.one_of(
    st.binary(max_size=8),
    # What looks nearly right: any command about our object.
    st.builds(
        lambda c, rest: bytes([c]) + b"\x20\x21\x00" + rest, st.integers(0, 255), st.binary(min_size=4, max_size=4)
    ),
)


class Babbler(ScriptedChannel):
    """Answers every frame with the next of the given ones, whatever was asked."""

    def __init__(self, frames: list[bytes]) -> None:
        super().__init__(5)
        self._frames = list(frames)

    def send(self, can_id: int, data: bytes) -> None:
        """Any request."""
        for _ in range(2):
            if self._frames:
                self.come(0.0, 0x585, self._frames.pop(0))


@settings(max_examples=examples(300))
@given(
    frames=st.lists(FRAME, max_size=30),
    what=st.sampled_from(["upload", "short", "long"]),
)
def test_no_answer_upsets_the_client(frames: list[bytes], what: str) -> None:
    channel = Babbler(frames)
    sdo = SdoClient(ServiceNetwork(channel, channel), 5, 0.1)
    do: dict[str, Callable[[], object]] = {
        "upload": lambda: sdo.upload(INDEX, SUB),
        "short": lambda: sdo.download(INDEX, SUB, b"abc"),
        "long": lambda: sdo.download(INDEX, SUB, bytes(500)),
    }
    for _ in range(3):
        try:
            do[what]()
        except (DeviceRefused, DeviceSilent, BusFault) as told:
            assert "\n" not in told.sentence


@settings(max_examples=60)
@given(st.data())
def test_a_spoilt_eds_is_read_or_refused_in_a_sentence(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    lines = EDS.read_text().splitlines()
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(lines) - 1))
        lines[at] = data.draw(
            st.one_of(st.text(max_size=20), st.just(lines[at][:5]), st.just(lines[at] + "0"), st.just(""))
        )
    path = tmp_path_factory.getbasetemp() / "spoilt.eds"
    path.write_text("\n".join(lines), encoding="utf-8")
    try:
        assert eds.load(path, 5).entries
    except ProductError as told:
        assert "spoilt.eds" in told.sentence
