"""The strict client of any request-and-answer protocol: an answer counts only if it belongs to the request."""

import threading
from collections.abc import Mapping
from typing import Literal

from station.adapters.canopen.network import ServiceNetwork
from station.adapters.object_access.request import ObjectProtocol, ObjectRefusal, ObjectRequest, Pending, Transport
from station.domain.product import sdo_codes
from station.errors import DeviceRefused, DeviceSilent, NodeShared
from station.messages import Message, Value

Address = tuple[int, int]
Access = Literal["read", "write"]

#: The code of a refusal that the protocol itself makes: it knows no such object.
NO_OBJECT = 0x06020000
#: A device that answers twice does so in exchange after exchange; a frame received twice is the bus's doing.
_CONSECUTIVE_EXCHANGES = 2
#: What was unlocked may be locked again after this time without a request (S3 of ISO 14229-2 is 5 s).
_UNLOCKED_S = 2.0
#: A device may ask for patience again and again, but not beyond so many times what it may take once.
_MOST_PATIENCE = 10


class ObjectClient:
    """Objects of one node. Every call holds the node's lock. answer_s: usual time for an answer; timeouts_s: objects
    that need another.

    A write is never repeated. After a time-out the node is in quarantine: the next call waits `answer_s`, drops what
    comes, and asks whether the device is there; devices answer in order, so no older answer can follow that one. An
    object whose write timed out must be read before it may be written again.
    """

    def __init__(
        self,
        network: ServiceNetwork,
        node: int,
        protocol: ObjectProtocol,
        transport: Transport,
        answer_s: float = 1.0,
        timeouts_s: Mapping[Address, float] | None = None,
    ) -> None:
        self.node, self.answer_s = node, answer_s
        self._clock, self._network = network.clock, network
        self._protocol, self._transport = protocol, transport
        self._timeouts_s = dict(timeouts_s or {})
        self._lock = threading.RLock()
        self._last_answer = b""
        self._repeated, self._consecutive_repeats, self._dropped = False, 0, 0
        self._pleas = 0
        self._quarantined = False
        self._doubtful: set[Address] = set()
        self._unlocked_s = -_UNLOCKED_S

    def upload(self, index: int, sub: int, timeout_s: float | None = None) -> bytes:
        """Raw value of an object. Errors: DeviceRefused, DeviceSilent; BusFault when two devices answer."""
        with self._lock:
            self._leave_quarantine()
            data = self._run("read", (index, sub), self._protocol.read(index, sub), timeout_s)
            self._doubtful.discard((index, sub))
            return data

    def download(self, index: int, sub: int, data: bytes, timeout_s: float | None = None) -> None:
        """Writes an object once. Errors: as upload; DeviceSilent at once for one whose last write is in doubt."""
        with self._lock:
            if (index, sub) in self._doubtful:
                raise DeviceSilent("sdo-write-in-doubt", node=self.node, object=sdo_codes.address(index, sub))
            self._leave_quarantine()
            request = self._protocol.write(index, sub, data)
            if request is not None:
                self._unlock((index, sub))
            try:
                self._run("write", (index, sub), request, timeout_s)
            except DeviceSilent:
                self._doubtful.add((index, sub))
                raise

    def reset(self) -> None:
        """Makes the device start again. Errors: DeviceRefused, DeviceSilent."""
        with self._lock:
            self._leave_quarantine()
            self._run("write", (0, 0), self._protocol.reset(), None)
            self._unlocked_s = -_UNLOCKED_S

    def alive(self, timeout_s: float) -> bool:
        """Whether the device answers at all."""
        with self._lock:
            self._drain()
            return self._exchange(self._protocol.alive(), timeout_s) is not None

    def _run(self, access: Access, at: Address, request: ObjectRequest | None, timeout_s: float | None) -> bytes:
        where: dict[str, Value] = {"node": self.node, "object": sdo_codes.address(*at)}
        if request is None:
            reason = sdo_codes.meaning(NO_OBJECT)
            raise DeviceRefused(
                Message(f"sdo-{access}-refused", reason=reason, code=NO_OBJECT, **where), code=NO_OBJECT
            )
        wait_s = timeout_s or self._timeouts_s.get(at, self.answer_s)
        self._drain()
        self._refuse_second_device()
        dropped, sent_s = self._dropped, self._clock.monotonic_s()
        answer = self._exchange(request, wait_s)
        if answer is None:
            self._quarantined = True
            if self._pleas:
                waited_s = round(self._clock.monotonic_s() - sent_s, 1)
                raise DeviceSilent("object-keeps-pending", count=self._pleas, waited_s=waited_s, **where)
            silence = Message(f"sdo-{access}-timed-out", timeout_s=wait_s, **where)
            count = self._dropped - dropped
            raise DeviceSilent(Message("answers-not-fitting", silence=silence, count=count) if count else silence)
        self._consecutive_repeats = self._consecutive_repeats + 1 if self._repeated else 0
        self._repeated = False
        self._refuse_second_device()
        if isinstance(answer, ObjectRefusal):
            shown = Message(f"object-{access}-refused", reason=answer.meaning, code=answer.code, **where)
            raise DeviceRefused(shown, code=answer.code)
        return answer

    def _exchange(self, request: ObjectRequest, wait_s: float) -> bytes | ObjectRefusal | None:
        """Sends, and waits for what answers it; None at the time-out."""
        self._transport.send(request.payload)
        sent_s, patience_s = self._clock.monotonic_s(), max(self._protocol.pending_s, wait_s)
        deadline_s, self._pleas = sent_s + wait_s, 0
        while (payload := self._transport.receive(deadline_s)) is not None:
            answer = request.judge(payload)
            if isinstance(answer, Pending):
                self._pleas += 1
                deadline_s = min(self._clock.monotonic_s() + patience_s, sent_s + _MOST_PATIENCE * patience_s)
            elif answer is not None:
                self._last_answer = payload
                return answer
            else:
                self._drop(payload)
        return None

    def _unlock(self, at: Address) -> None:
        """Session and key, unless they were asked for a moment ago."""
        if self._clock.monotonic_s() - self._unlocked_s < _UNLOCKED_S:
            return
        steps = self._protocol.unlocking()
        try:
            request = next(steps)
            while True:
                request = steps.send(self._run("write", at, request, None))
        except StopIteration:
            self._unlocked_s = self._clock.monotonic_s()

    def _drain(self) -> None:
        """Drops what has come and belongs to no request."""
        self._network.catch_up()
        while (payload := self._transport.receive(-1.0)) is not None:
            self._drop(payload)

    def _drop(self, payload: bytes) -> None:
        self._dropped += 1
        self._repeated = self._repeated or payload == self._last_answer

    def _refuse_second_device(self) -> None:
        if self._consecutive_repeats + self._repeated >= _CONSECUTIVE_EXCHANGES:
            raise NodeShared("node-id-twice", node=self.node)

    def _leave_quarantine(self) -> None:
        if not self._quarantined:
            return
        self._network.wait(lambda: False, self._clock.monotonic_s() + self.answer_s)
        self._drain()
        if self._exchange(self._protocol.alive(), self.answer_s) is None:
            raise DeviceSilent("device-not-there", node=self.node, timeout_s=self.answer_s)
        self._quarantined = False
        self._unlocked_s = -_UNLOCKED_S
