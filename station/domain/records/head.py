"""The head of a log, kept outside it: how far it had come, and its seal there. What it says against the log.

A head is one line of JSON: on a certificate, in a file, in an answer. Where the log is signed, its head carries the
newest record's own signature: the seal commits to the log's id and to every record before it.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

from station.domain.records.json_object import json_object
from station.messages import Message

SCHEMA = "station.head/1"


@lru_cache(maxsize=16)
def _quoted(text: str) -> str:
    return json.dumps(text)


@dataclass(frozen=True, slots=True)
class SealedHead:
    """log_id: what sets the log apart; station: who keeps it; number, hash, signature: of its newest record, in hex."""

    log_id: str
    station: str
    number: int
    hash: str
    signature: str = ""

    def line(self) -> str:
        """As it is kept: JSON, put together by hand, for it is written after each commit."""
        names = f'"schema": "{SCHEMA}", "log_id": {_quoted(self.log_id)}, "station": {_quoted(self.station)}'
        signature = f', "signature": "{self.signature}"' if self.signature else ""
        return f'{{{names}, "number": {self.number}, "hash": "{self.hash}"{signature}}}'

    @staticmethod
    def parse(text: str) -> "SealedHead":
        """The head of such a line, that of version 0.1 too, which named no station. Errors: ValueError."""
        try:
            stored = json_object(text)
            seal = bytes.fromhex(stored["hash"])
            signature = bytes.fromhex(stored.get("signature", ""))
            number = int(stored["number"])
            names = str(stored["log_id"]), str(stored.get("station", ""))
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise ValueError("no head of a log") from error
        if number < 0 or len(seal) != 32:
            raise ValueError("no head of a log")
        return SealedHead(*names, number, seal.hex(), signature.hex())


class LogEnd(Protocol):
    """What a log says of itself to a head: who it is, its last number, seals by number, finishes beyond a number."""

    log_id: str
    number: int
    #: A check of (number, signature, seal) where the log's heads are signed.
    verify: Callable[[int, bytes, bytes], bool] | None

    def seal(self, number: int) -> bytes | None:
        """The seal of the record with that number; None where there is none."""

    def finishes_beyond(self, number: int) -> int:
        """How many attempts ended after that record."""


@dataclass(frozen=True, slots=True)
class AnchorFinding:
    """What one place says against the log. what: missing | unreadable | foreign | zero | older | replaced | truncated |
    forged; number: the record that it speaks of."""

    what: str
    place: str
    number: int
    message: Message


def against(place: str, head: SealedHead, log: LogEnd, *, lags: bool) -> AnchorFinding | None:
    """What a head says against a log; None where they agree.

    lags: the place may be behind by any number of loads (a share that was away). The head file itself may lag by what
    one crash leaves: the newest finish and what follows it.
    """
    what = _disagreement(head, log, behind=log.number if lags else 1)
    if not what:
        return None
    message = Message(f"anchor-{what}", place=place, number=head.number, last=log.number)
    return AnchorFinding(what, place, head.number, message)


def _disagreement(head: SealedHead, log: LogEnd, behind: int) -> str:
    """behind: so many attempts may have ended since."""
    if head.log_id != log.log_id:
        return "foreign"
    if head.number > log.number:
        return "truncated"
    signed = head.number, bytes.fromhex(head.signature), bytes.fromhex(head.hash)
    if log.verify and head.number and not log.verify(*signed):
        return "forged"
    if head.number and log.seal(head.number) != bytes.fromhex(head.hash):
        return "replaced"
    if log.finishes_beyond(head.number) > behind:
        return "older" if head.number else "zero"
    return ""


def missing(place: str) -> AnchorFinding:
    """The place holds no head, although the log was kept there."""
    return AnchorFinding("missing", place, 0, Message("anchor-missing", place=place))


def unreadable(place: str) -> AnchorFinding:
    """The place holds something else than a head."""
    return AnchorFinding("unreadable", place, 0, Message("anchor-unreadable", place=place))
