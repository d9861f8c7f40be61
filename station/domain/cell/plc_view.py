"""What a PLC says at one instant, and what a station may conclude from it; for the positioner and for the line."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from station.domain.cell import register_map
from station.domain.cell.register_map import INPUTS, PROTOCOL, RegisterMap
from station.domain.core import rotation
from station.domain.core.types import Floats
from station.messages import Message

#: Quaternions travel as four i32 of this scale, scalar first: 1e-9 of a radian is nothing.
SCALE = 1_000_000_000
#: The PLC's heartbeat counts tenths of a second of its own clock, modulo 65536.
BEATS_PER_S, MODULUS = 10, 65536


class MoveState(IntEnum):
    """How far the PLC is with the present move."""

    IDLE = 0
    OFFERED = 1  # target and number are echoed; it waits for go
    MOVING = 2
    DONE = 3
    REFUSED = 4
    STOPPED = 5


@dataclass(frozen=True, slots=True)
class PlcView:
    """One read of the whole block. status: names of the flags that are set; unknown_bits: a word of those that the map
    does not name; target_echo, actual: quaternions as sent; present: nests (from 0) with a part."""

    protocol: int
    heartbeat: int
    starts: int
    status: frozenset[str]
    unknown_bits: int
    fault: int
    move_echo: int
    move_state: int
    target_echo: tuple[int, ...]
    actual: tuple[int, ...]
    present: frozenset[int]
    load: int
    load_taken: int
    bins_taken: int

    def attitude(self) -> Floats | None:
        """Nest → station rotation (3, 3) that the PLC measures; None where its four numbers are no rotation."""
        q = np.array(self.actual, float) / SCALE
        return rotation.from_quaternion(q) if abs(float(np.linalg.norm(q)) - 1) < 1e-3 else None


def view(plc: RegisterMap, words: list[int]) -> PlcView:
    """The block of inputs, as read in one request from its first register on."""
    first = register_map.span(plc.inputs.at, INPUTS).start

    def numbers(name: str) -> tuple[int, ...]:
        kind, count = INPUTS[name]
        at = plc.inputs.at[name] - first
        return register_map.numbers_of(plc, kind, words[at : at + count * register_map.WORDS[kind]])

    def number(name: str) -> int:
        return numbers(name)[0]

    status, present = number("status"), number("present")
    known = register_map.pack_bits(plc.status, frozenset(plc.status))
    return PlcView(
        protocol=number("protocol"),
        heartbeat=number("heartbeat"),
        starts=number("starts"),
        status=frozenset(name for name, bit in plc.status.items() if status >> bit & 1),
        unknown_bits=status & ~known,
        fault=number("fault"),
        move_echo=number("move-echo"),
        move_state=number("move-state"),
        target_echo=numbers("target-echo"),
        actual=numbers("actual"),
        present=frozenset(i for i in range(register_map.MOST_NESTS) if present >> i & 1),
        load=number("load"),
        load_taken=number("load-taken"),
        bins_taken=number("bins-taken"),
    )


def protocol_fault(plc: PlcView) -> Message | None:
    """Why this PLC may not be worked with at all."""
    if plc.protocol != PROTOCOL:
        return Message("plc-protocol", protocol=plc.protocol, known=PROTOCOL)
    if plc.unknown_bits:
        return Message("plc-unknown-bits", bits=f"0x{plc.unknown_bits:04X}")
    return None


def unsafe(plc: PlcView, needed: Mapping[str, str]) -> Message | None:
    """The first of the flags that must be set and is not. needed: flag → id of the message that says so."""
    for flag, id_ in needed.items():
        if flag not in plc.status:
            return Message(id_)
    return None


def quaternion_of(R: Floats) -> tuple[int, int, int, int]:
    """A rotation (3, 3) as it travels: scalar first, never negative, scaled to whole numbers."""
    v = rotation.to_vector(R)
    angle = float(np.linalg.norm(v))
    axis = v / angle if angle > 0 else np.zeros(3)
    q = np.array([np.cos(angle / 2), *(np.sin(angle / 2) * axis)])
    w, x, y, z = (round(float(c) * SCALE) for c in q)
    return w, x, y, z


def angle_between_deg(a: tuple[int, ...], b: tuple[int, ...]) -> float:
    """Angle between two rotations as they travel, degrees; infinity where one of them is none."""
    p, q = np.array(a, float) / SCALE, np.array(b, float) / SCALE
    if min(np.linalg.norm(p), np.linalg.norm(q)) < 0.5:
        return float("inf")
    R = rotation.from_quaternion(p).T @ rotation.from_quaternion(q)
    return float(np.rad2deg(np.linalg.norm(rotation.to_vector(R))))


def next_number(echo: int) -> int:
    """The number of the next move: another than the one the PLC holds, never 0."""
    return echo % (MODULUS - 1) + 1


def beats_since(now: int, then: int) -> int:
    """Tenths of a second between two heartbeats of the PLC, modulo 65536."""
    return (now - then) % MODULUS
