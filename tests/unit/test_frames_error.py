"""Error frames in words, as <linux/can/error.h> defines their bits."""

import numpy as np
import pytest

from station.domain.can.error_frames import error_frames, has_bus_off
from station.domain.core.types import ERROR, Frames
from station.messages import render

BUS_OFF, RESTARTED = 0x40, 0x100


def _frames(*rows: tuple[int, dict[int, int]]) -> Frames:
    data = np.zeros((len(rows), 8), np.uint8)
    for row, (_, payload) in enumerate(rows):
        for byte, value in payload.items():
            data[row, byte] = value
    n = len(rows)
    return Frames(np.arange(n), np.array([i for i, _ in rows], np.uint32), np.full(n, 8, np.uint8), data)


@pytest.mark.parametrize(
    ("kind", "payload", "printed"),
    [
        (0x001, {}, ["a frame could not be sent in time"]),
        (0x004, {1: 0x01}, ["the adapter's receive buffer overflowed: frames are lost"]),
        (
            0x004,
            {1: 0x0C},
            ["error warning level reached while receiving", "error warning level reached while sending"],
        ),
        (0x004, {1: 0x30}, ["error passive while receiving", "error passive while sending"]),
        (0x004, {1: 0x40}, ["back to error active"]),
        (0x004, {}, ["controller problem"]),
        (0x008, {2: 0x04}, ["bit stuffing error"]),
        (0x008, {2: 0x80 | 0x10}, ["a recessive bit could not be sent", "the error occurred while sending"]),
        (0x010, {4: 0x80}, ["transceiver: CAN_L is shorted to CAN_H"]),
        (0x080, {}, ["bus error"]),
        (RESTARTED, {}, ["the controller was restarted after bus-off"]),
        (0x002 | 0x080, {}, ["arbitration lost", "bus error"]),
    ],
)
def test_each_class_and_detail_has_its_words(kind: int, payload: dict[int, int], printed: list[str]) -> None:
    assert [render(m) for m in error_frames(_frames((ERROR | kind, payload)))] == printed


def test_missing_acknowledgement_and_bus_off_name_what_to_check() -> None:
    shown = error_frames(_frames((ERROR | 0x20, {}), (ERROR | BUS_OFF, {})))
    assert all("check" in render(m) and "bit rate" in render(m) for m in shown)


def test_repetitions_are_counted_and_data_frames_ignored() -> None:
    rows = [(ERROR | 0x80, {}), (0x84, {1: 0xFF}), (ERROR | 0x20, {}), (ERROR | 0x80, {}), (ERROR | 0x80, {})]
    shown = error_frames(_frames(*rows))
    assert render(shown[0]) == "bus error (3 times)"
    assert len(shown) == 2
    assert error_frames(_frames((0x40, {}))) == error_frames(Frames.empty()) == ()


def test_bus_off_lasts_until_the_restart() -> None:
    payload: dict[int, int] = {}
    off, on, data = (ERROR | BUS_OFF, payload), (ERROR | RESTARTED, payload), (0x140, payload)
    assert has_bus_off(_frames(data, off, data))
    assert not has_bus_off(_frames(off, on))
    assert has_bus_off(_frames(off, on, off))
    assert not has_bus_off(_frames(data))
