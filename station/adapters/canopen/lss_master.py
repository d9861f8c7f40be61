"""The strict LSS master: one answer where one device is meant, a scan that is asked again when it contradicts itself.

It closes these holes of common masters: half a second for every bit that nobody confirms, a slow device's answer taken
for the next bit's, a device that selects itself too early, two devices configured at once.
"""

from collections import deque
from collections.abc import Generator
from dataclasses import dataclass
from typing import TypeVar

from station.adapters.canopen import lss_transfer
from station.adapters.canopen.lss_transfer import LssRequest, lss_frame
from station.adapters.canopen.network import ServiceNetwork
from station.errors import BusFault, DeviceSilent, UnitFault, UsageError
from station.messages import Message
from station.ports.lss import UNCONFIGURED, LssIdentity

LSS_REQUEST, LSS_ANSWER = 0x7E5, 0x7E4
_MOST_WAITING = 1024
#: A scan that contradicts itself is repeated so often, each time twice as slowly.
_SCANS = 3
ServiceResult = TypeVar("ServiceResult")


@dataclass(frozen=True, slots=True)
class LssTiming:
    """answer_s: for the answer of one device; store_s: while it writes its memory; guard_s: for a second device's.

    bit_s: silence that means "no" in a scan; late_s: from a first "yes" to that of the slowest device.
    """

    answer_s: float = 0.1
    store_s: float = 2.0
    guard_s: float = 0.005
    bit_s: float = 0.035
    late_s: float = 0.008


class CanopenLssMaster:
    """Implements station.ports.lss.LssMaster on a ServiceNetwork whose channel hears 0x7E4."""

    def __init__(self, network: ServiceNetwork, timing: LssTiming = LssTiming()) -> None:
        self._network = network
        self._timing = timing
        self._slowness = 1
        self._inbox: deque[bytes] = deque(maxlen=_MOST_WAITING)
        self._last: LssRequest | None = None
        self._selected: LssIdentity | None = None
        network.subscribe(LSS_ANSWER, lambda _id, data, _time: self._inbox.append(bytes(data)))

    def release(self) -> None:
        """Switch state global: every device waits."""
        self._exchange(LssRequest(lss_frame(lss_transfer.SWITCH_GLOBAL, 0)), 0.0)

    def holds_any(self) -> bool:
        """Whether anybody answers who may only when selected."""
        request = LssRequest(lss_frame(lss_transfer.INQUIRE_NODE), lss_transfer.INQUIRE_NODE, several=True)
        return self._exchange(request, self._timing.answer_s) is not None

    def select(self, identity: LssIdentity) -> bool:
        """Switch state selective, and the identity read back. Errors: BusFault, UnitFault."""
        try:
            selected = self._drive(lss_transfer.select_identity(identity), self._timing.answer_s)
        except lss_transfer.EarlySelection:
            raise self._early() from None
        if not selected:
            return False
        self._check_identity(identity)
        return True

    def scan(self, hint: LssIdentity | None = None) -> LssIdentity | None:
        """Fast scan, and the identity read back. Errors: BusFault, UnitFault."""
        for attempt in range(_SCANS):
            self._slowness = 1 << attempt
            self.release()
            try:
                found = self._drive(lss_transfer.scan_identity(hint), self._timing.bit_s * self._slowness)
            except lss_transfer.EarlySelection:
                raise self._early() from None
            except lss_transfer.ScanLost:
                if self.holds_any():
                    raise self._early() from None
                continue
            if found is not None:
                self._check_identity(found)
            return found
        raise BusFault("lss-scan-contradicts", count=_SCANS)

    def inquire(self) -> LssIdentity:
        """Four numbers, one answer each."""
        commands = lss_transfer.INQUIRE
        numbers = [
            self._ask(lss_frame(c), c, Message("lss-to-say-its-identity"), alone=c == commands[-1])[1:5]
            for c in commands
        ]
        return LssIdentity(*(int.from_bytes(n, "little") for n in numbers))

    def node_id(self) -> int:
        """Active node id."""
        return self._ask(
            lss_frame(lss_transfer.INQUIRE_NODE), lss_transfer.INQUIRE_NODE, Message("lss-to-say-its-node")
        )[1]

    def configure_node(self, node: int) -> None:
        """Pending node id. Errors: UsageError for one that is none."""
        if not 1 <= node <= 127 and node != UNCONFIGURED:
            raise UsageError("lss-node", node=node)
        self._command(lss_frame(lss_transfer.CONFIGURE_NODE, node), Message("lss-to-take-a-node"))

    def configure_bit_rate(self, kbit_s: int) -> None:
        """Pending bit rate. Errors: UsageError for one that is not in CiA 305's table."""
        if kbit_s not in lss_transfer.BIT_TIMINGS:
            raise UsageError("lss-bit-rate", kbit_s=kbit_s, known=tuple(lss_transfer.BIT_TIMINGS))
        index = lss_transfer.BIT_TIMINGS[kbit_s]
        self._command(lss_frame(lss_transfer.CONFIGURE_BIT_TIMING, 0, index), Message("lss-to-take-a-bit-rate"))

    def store(self) -> None:
        """Store configuration."""
        self._command(lss_frame(lss_transfer.STORE), Message("lss-to-store"), self._timing.store_s)

    def _early(self) -> UnitFault:
        """Nobody was selected; who is being configured all the same?"""
        found = self.inquire()
        self.release()
        return UnitFault("lss-selected-early", serial=found.serial)

    def _check_identity(self, wanted: LssIdentity) -> None:
        found = self.inquire()
        if found != wanted:
            raise UnitFault("lss-other-identity", wanted=wanted.serial, found=found.serial)
        self._selected = found

    def _command(self, data: bytes, service: Message, timeout_s: float | None = None) -> None:
        answer = self._ask(data, data[0], service, timeout_s, alone=True)
        if answer[1]:
            serial = 0 if self._selected is None else self._selected.serial
            why = _why_refused(data[0], answer[1])
            raise UnitFault("lss-refused", serial=serial, service=service, why=why, error=answer[1], detail=answer[2])

    def _ask(
        self, data: bytes, answer: int, service: Message, timeout_s: float | None = None, *, alone: bool = False
    ) -> bytes:
        wait_s = timeout_s or self._timing.answer_s
        got = self._exchange(LssRequest(data, answer, alone=alone), wait_s)
        if got is None:
            raise DeviceSilent("lss-silent", service=service, timeout_s=wait_s)
        return got

    def _drive(self, service: Generator[LssRequest, bytes | None, ServiceResult], timeout_s: float) -> ServiceResult:
        try:
            request = next(service)
            while True:
                request = service.send(self._exchange(request, timeout_s))
        except StopIteration as done:
            result: ServiceResult = done.value
            return result

    def _exchange(self, request: LssRequest, timeout_s: float) -> bytes | None:
        """Sends, and waits for the answer; None at the time-out, or where none is to come."""
        self._drain()
        self._last = request
        self._network.send(LSS_REQUEST, request.data)
        clock = self._network.clock
        if request.answer is None:
            return None
        deadline_s = clock.monotonic_s() + (self._timing.guard_s if request.early else timeout_s)
        while self._network.wait(lambda: bool(self._inbox), deadline_s):
            answer = self._inbox.popleft()
            if len(answer) == 8 and answer[0] == request.answer:
                self._wait_for_others(request)
                return answer
            self._refuse_stray(answer)
        return None

    def _wait_for_others(self, request: LssRequest) -> None:
        clock, timing = self._network.clock, self._timing
        if request.several:
            self._network.wait(lambda: False, clock.monotonic_s() + timing.late_s * self._slowness)
        elif request.alone and self._network.wait(lambda: bool(self._inbox), clock.monotonic_s() + timing.guard_s):
            self._refuse_stray(self._inbox.popleft())

    def _drain(self) -> None:
        self._network.catch_up()
        while self._inbox:
            self._refuse_stray(self._inbox.popleft())

    def _refuse_stray(self, answer: bytes) -> None:
        """An answer that nobody may give now is a second device's; those of a scan may come late."""
        if len(answer) != 8 or answer[0] == lss_transfer.SCANNED:
            return
        if self._last is None or not self._last.several:
            raise BusFault("lss-answered-twice", command=answer[0])


def _why_refused(command: int, error: int) -> Message:
    """What CiA 305 says of an error of a configuration service: 1 and 2 are defined, the rest is the maker's."""
    if error == 1:
        return Message("lss-cannot-store" if command == lss_transfer.STORE else "lss-out-of-range")
    return Message("lss-memory-failed" if error == 2 and command == lss_transfer.STORE else "lss-reason-of-maker")
