"""LSS services of a master as generators: they yield a request and are sent the answer, or None where none came.

No bus, no clock: the driver (`lss_master`) owns both. Source: CiA 305.
"""

from collections.abc import Generator
from dataclasses import dataclass

from station.ports.lss import LssIdentity

SWITCH_GLOBAL, CONFIGURE_NODE, CONFIGURE_BIT_TIMING, STORE = 0x04, 0x11, 0x13, 0x17
SELECT, SELECTED = (0x40, 0x41, 0x42, 0x43), 0x44
SCANNED, SCAN = 0x4F, 0x51
INQUIRE, INQUIRE_NODE = (0x5A, 0x5B, 0x5C, 0x5D), 0x5E
#: Bit check of the request with which a fast scan begins.
RESET = 0x80
#: Index in the table of bit timings, by kbit/s.
BIT_TIMINGS = {1000: 0, 800: 1, 500: 2, 250: 3, 125: 4, 50: 6, 20: 7, 10: 8}


@dataclass(frozen=True, slots=True)
class LssRequest:
    """One frame, and the command specifier that answers it (None: nothing does).

    several: many devices may answer at once; alone: a second answer is waited for, and is a fault; early: nobody may
    answer yet, which is soon known.
    """

    data: bytes
    answer: int | None = None
    several: bool = False
    alone: bool = False
    early: bool = False


class EarlySelection(Exception):
    """A device takes itself for selected before its whole identity was named."""


class ScanLost(Exception):
    """No device has the number that its answers spelt: an answer came late, or was lost."""


Answer = bytes | None
Selection = Generator[LssRequest, Answer, bool]
Scan = Generator[LssRequest, Answer, LssIdentity | None]


def lss_frame(command: int, *rest: int, number: int | None = None) -> bytes:
    """Eight bytes: the command specifier, an UNSIGNED32 or single bytes, zeros."""
    body = bytes(rest) if number is None else number.to_bytes(4, "little") + bytes(rest)
    return (bytes([command]) + body).ljust(8, b"\0")


def select_identity(identity: LssIdentity) -> Selection:
    """Switch state selective: four numbers, one answer. Errors: EarlySelection."""
    for command, number in zip(SELECT[:2], identity.numbers[:2], strict=True):
        yield LssRequest(lss_frame(command, number=number))
    if (yield LssRequest(lss_frame(SELECT[2], number=identity.revision), SELECTED, early=True)) is not None:
        raise EarlySelection
    return (yield LssRequest(lss_frame(SELECT[3], number=identity.serial), SELECTED)) is not None


def scan_identity(hint: LssIdentity | None) -> Scan:
    """Fast scan: bit by bit, each device whose number fits so far answers. Errors: EarlySelection, ScanLost."""
    if (yield _question(0, RESET, 0, 0)) is None:
        return None
    found: list[int] = []
    for part in range(4):
        if part and (yield LssRequest(lss_frame(INQUIRE_NODE), INQUIRE_NODE, several=True)) is not None:
            raise EarlySelection
        guess = None if hint is None or part == 3 else hint.numbers[part]
        found.append((yield from _scan_number(part, guess)))
    return LssIdentity(*found)


def _scan_number(part: int, guess: int | None) -> Generator[LssRequest, Answer, int]:
    following = (part + 1) % 4
    if guess is not None and (yield _question(guess, 0, part, following)) is not None:
        return guess
    number = 0
    for bit in reversed(range(32)):
        if (yield _question(number, bit, part, part)) is None:
            number |= 1 << bit
    if (yield _question(number, 0, part, following)) is None:
        raise ScanLost
    return number


def _question(number: int, bit: int, part: int, following: int) -> LssRequest:
    return LssRequest(lss_frame(SCAN, bit, part, following, number=number), SCANNED, several=True)
