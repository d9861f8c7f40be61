"""The strict SDO client: an answer counts only if it belongs to the request; after a time-out nothing is assumed.

It closes these holes of common clients: a late answer to an earlier request taken for this one's, two callers
mixing their transfers, abort codes hidden, a command repeated that had been executed.
"""

import threading
from collections import deque
from collections.abc import Callable, Generator, Mapping
from typing import Literal, TypeVar

from canopen.sdo import constants as sdo

from station.adapters.canopen import sdo_block, sdo_transfer
from station.adapters.canopen.network import ServiceNetwork
from station.adapters.canopen.sdo_transfer import Exchange, NoAnswer, Refused, Violation
from station.domain.product import sdo_codes
from station.errors import DeviceRefused, DeviceSilent, NodeShared
from station.messages import Message

TransferResult = TypeVar("TransferResult")
Address = tuple[int, int]
Access = Literal["read", "write"]

#: Longer values go in blocks, where the device knows them.
BLOCK_FROM = 400
#: More than a block's segments, and a bound to what a babbling node may heap up.
_MOST_WAITING = 4096
#: An abort in the middle of saving may do harm, so these time-outs are silent.
_STORES = (0x1010, 0x1011)
#: A second device may be so many requests behind the first; so many exchanges running it must have answered too.
_REMEMBERED_EXCHANGES, _CONSECUTIVE_EXCHANGES = 32, 2
#: A transfer may last so many times what an answer may take, and what written bytes take on the slowest bus: a
#: device that sends a value in drops, or without end, would hold up all units.
_PATIENCE, _LEAST_BYTES_PER_S = 10, 100.0
#: Mandatory objects that any device answers for: they tell when it has caught up.
_FENCES = ((0x1000, 0), (0x1001, 0))


class _Endless(Exception):
    """A transfer goes on and on."""


class SdoClient:
    """SDO of one node. Every call holds the node's lock, so threads take turns.

    network: shared by all nodes; answer_s: usual time for an answer; timeouts_s: objects that need another;
    sizes: bytes of objects, for a device that does not say them (CiA 301, 7.2.4.3.6).
    After a time-out the node is in quarantine: the next call waits `answer_s`, drops what comes, and reads a
    mandatory object. The device answers in order, so that answer proves that no older one can follow it. An
    object whose write timed out must be read before it may be written again.

    Answers that repeat those to earlier requests are counted by the exchange in which they come. One may be the bus's
    doing (a frame received twice, CAN 2.0 part A, 4.2); in two exchanges running they come of a second device.
    """

    def __init__(
        self,
        network: ServiceNetwork,
        node: int,
        answer_s: float = 1.0,
        timeouts_s: Mapping[Address, float] | None = None,
        sizes: Mapping[Address, int] | None = None,
    ) -> None:
        self.node = node
        self.answer_s = answer_s
        self.dropped = 0
        self._timeouts_s, self._sizes = dict(timeouts_s or {}), dict(sizes or {})
        self._network = network
        self._lock = threading.RLock()
        self._inbox: deque[bytes] = deque(maxlen=_MOST_WAITING)
        self._answered: deque[Callable[[bytes], bool]] = deque(maxlen=_REMEMBERED_EXCHANGES)
        self._repeated = False
        self._consecutive_repeats = 0
        self._quarantined_by: Address | None = None
        self._doubtful: set[Address] = set()
        self._has_blocks = True
        network.subscribe(0x580 + node, lambda _id, data, _time: self._inbox.append(bytes(data)))

    def upload(self, index: int, sub: int, timeout_s: float | None = None) -> bytes:
        """Raw value of an object, expedited or in segments.

        Errors: DeviceRefused with the abort code as a sentence; DeviceSilent; BusFault when two devices answer.
        """
        with self._lock:
            data = self._run(
                "read", index, sub, timeout_s, lambda: sdo_transfer.upload(index, sub, self._sizes.get((index, sub)))
            )
            self._doubtful.discard((index, sub))
            return data

    def download(self, index: int, sub: int, data: bytes, timeout_s: float | None = None) -> None:
        """Writes an object once: expedited, in segments, or in blocks when it is long. Never repeated.

        Errors: as upload; DeviceSilent at once for an object whose last write timed out and was not read since.
        """
        with self._lock:
            self._refuse_doubtful(index, sub)
            try:
                self._download(index, sub, data, timeout_s)
            except DeviceSilent:
                self._doubtful.add((index, sub))
                raise

    def _download(self, index: int, sub: int, data: bytes, timeout_s: float | None) -> None:
        if len(data) > BLOCK_FROM and self._has_blocks:
            try:
                self._run("write", index, sub, timeout_s, lambda: sdo_block.download(index, sub, data), len(data))
            except DeviceRefused as refusal:
                if refusal.code != sdo.ABORT_INVALID_COMMAND_SPECIFIER:
                    raise
                self._has_blocks = False
            else:
                return
        self._run("write", index, sub, timeout_s, lambda: sdo_transfer.download(index, sub, data), len(data))

    def _run(
        self,
        access: Access,
        index: int,
        sub: int,
        timeout_s: float | None,
        make: Callable[[], Generator[Exchange, bytes, TransferResult]],
        size: int = 0,
    ) -> TransferResult:
        self._leave_quarantine()
        timeout_s = timeout_s or self._timeouts_s.get((index, sub), self.answer_s)
        before, limit_s = self.dropped, _PATIENCE * timeout_s + size / _LEAST_BYTES_PER_S
        try:
            return self._drive(make(), index, sub, timeout_s, self._network.clock.monotonic_s() + limit_s)
        except Refused as refusal:
            raise self._refused(f"sdo-{access}-refused", index, sub, refusal.code) from None
        except Violation as violation:
            self._abort(index, sub, violation.code)
            raise self._refused(f"sdo-{access}-broken", index, sub, violation.code) from None
        except _Endless:
            self._abort(index, sub, sdo.ABORT_TIMED_OUT)
            shown = Message(
                f"sdo-{access}-endless", node=self.node, object=sdo_codes.address(index, sub), limit_s=limit_s
            )
            raise DeviceRefused(shown, code=sdo.ABORT_TIMED_OUT) from None
        except NoAnswer:
            raise DeviceSilent(self._time_out(access, index, sub, timeout_s, self.dropped - before)) from None

    def _refused(self, id_: str, index: int, sub: int, code: int) -> DeviceRefused:
        where = sdo_codes.address(index, sub)
        reason = sdo_codes.meaning(code)
        return DeviceRefused(Message(id_, node=self.node, object=where, reason=reason, code=code), code=code)

    def _drive(
        self,
        transfer: Generator[Exchange, bytes, TransferResult],
        index: int,
        sub: int,
        timeout_s: float,
        until_s: float,
    ) -> TransferResult:
        try:
            exchange = next(transfer)
            while True:
                if exchange.send:
                    self._drain()
                    self._refuse_second_device()
                answer = self._exchange(exchange, index, sub, timeout_s)
                if answer is not None and exchange.send:
                    self._remember(exchange)
                    self._refuse_second_device()
                if self._network.clock.monotonic_s() > until_s:
                    raise _Endless
                exchange = transfer.throw(NoAnswer()) if answer is None else transfer.send(answer)
        except StopIteration as done:
            result: TransferResult = done.value
            return result

    def _exchange(self, exchange: Exchange, index: int, sub: int, timeout_s: float) -> bytes | None:
        """Sends, and waits for the answer that fits; Refused when it is an abort; None at the time-out."""
        for data in exchange.send:
            self._network.send(0x600 + self.node, data)
        if exchange.fits is None:
            return b""
        deadline_s = self._network.clock.monotonic_s() + timeout_s
        while self._network.wait(lambda: bool(self._inbox), deadline_s):
            answer = self._inbox.popleft()
            if len(answer) == 8 and answer[0] == sdo.RESPONSE_ABORTED:
                if answer[1:4] in (sdo_transfer.initiate_header(0, index, sub)[1:], bytes(3)):
                    raise Refused(int.from_bytes(answer[4:8], "little"))
            elif len(answer) == 8 and exchange.fits(answer):
                return answer
            self._drop(answer)
        return None

    def _drain(self) -> None:
        """Drops what has come and belongs to no request."""
        self._network.catch_up()
        for _ in range(len(self._inbox)):
            self._drop(self._inbox.popleft())

    def _drop(self, answer: bytes) -> None:
        self.dropped += 1
        self._repeated = self._repeated or (len(answer) == 8 and any(fits(answer) for fits in self._answered))

    def _remember(self, exchange: Exchange) -> None:
        """The exchange was answered: its answer may come once more, and so did that to an earlier one or not."""
        self._consecutive_repeats = self._consecutive_repeats + 1 if self._repeated else 0
        self._repeated = False
        if exchange.fits is not None:
            self._answered.append(exchange.fits)

    def _refuse_second_device(self) -> None:
        if self._consecutive_repeats + self._repeated >= _CONSECUTIVE_EXCHANGES:
            raise NodeShared("node-id-twice", node=self.node)

    def _time_out(self, access: Access, index: int, sub: int, timeout_s: float, dropped: int) -> Message:
        """Quarantines the node; returns the message."""
        if index not in _STORES:
            self._abort(index, sub, sdo.ABORT_TIMED_OUT)
        self._quarantined_by = (index, sub)
        where = sdo_codes.address(index, sub)
        silence = Message(f"sdo-{access}-timed-out", node=self.node, object=where, timeout_s=timeout_s)
        return Message("sdo-foreign-answers", silence=silence, count=dropped) if dropped else silence

    def _abort(self, index: int, sub: int, code: int) -> None:
        self._network.send(
            0x600 + self.node,
            sdo_transfer.initiate_header(sdo.REQUEST_ABORTED, index, sub) + code.to_bytes(4, "little"),
        )

    def _leave_quarantine(self) -> None:
        if self._quarantined_by is None:
            return
        culprit, self._quarantined_by = self._quarantined_by, None
        clock = self._network.clock
        self._network.wait(lambda: False, clock.monotonic_s() + self.answer_s)
        self._answered.clear()
        index, sub = _FENCES[culprit == _FENCES[0]]
        self._run("read", index, sub, None, lambda: sdo_transfer.upload(index, sub))

    def _refuse_doubtful(self, index: int, sub: int) -> None:
        if (index, sub) in self._doubtful:
            where = sdo_codes.address(index, sub)
            raise DeviceSilent("sdo-write-in-doubt", node=self.node, object=where)
