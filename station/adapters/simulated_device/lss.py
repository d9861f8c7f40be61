"""The LSS slave of a simulated device (CiA 305), and a device that has no node id until it is given one."""

from collections.abc import Callable
from functools import partial

from station.adapters.simulated_device.nonvolatile import NonVolatileMemory
from station.adapters.simulated_device.sdo import Agenda
from station.domain.core.types import ERROR, EXTENDED, REMOTE
from station.ports.bus import Endpoint
from station.ports.clock import Actor, Clock
from station.ports.lss import UNCONFIGURED, LssIdentity

#: Identifiers that the endpoint of an LssDevice must receive: NMT and the LSS master's.
LSS_RECEIVED = (0x000, 0x7E5)
_NMT, _MASTER = LSS_RECEIVED
_ANSWER = 0x7E4
_NODE_KEY, _BIT_KEY = "node", "bit_timing"
_RESETS = (0x81, 0x82)
_LAST_PART, _BIT_TIMINGS, _REFUSED = 3, (0, 1, 2, 3, 4, 6, 7, 8), 1


class LssSlave:
    """State machine of one slave: frames in, frames out. factory: its node id before any was stored.

    fault: lss-early selects itself once vendor and product fit; lss-twice answers everything twice.
    """

    def __init__(
        self, identity: LssIdentity, memory: NonVolatileMemory, factory: int = UNCONFIGURED, fault: str = ""
    ) -> None:
        self.identity = identity
        self._memory, self._factory, self._fault = memory, factory, fault
        self.power_on()

    def power_on(self) -> None:
        """As after power-on: what was not stored is lost."""
        saved = self._memory.objects()
        self.node = self.pending = int(saved.get(_NODE_KEY, self._factory))
        self.bit_timing = int(saved.get(_BIT_KEY, 2))
        self.configuring = False
        self._matched = self._part = 0

    def take(self, data: bytes) -> tuple[bytes, ...]:
        """Answers to a frame of the master."""
        answer = self._answer(data[0], data[1:]) if len(data) == 8 else None
        if answer is None:
            return ()
        return (answer.ljust(8, b"\0"),) * (2 if self._fault == "lss-twice" else 1)

    def _answer(self, command: int, rest: bytes) -> bytes | None:
        number = int.from_bytes(rest[:4], "little")
        if command == 0x04:
            self.configuring = rest[0] == 1
            return None
        if 0x40 <= command <= 0x43:
            return self._select(command - 0x40, number)
        if command == 0x51:
            return self._scan(number, *rest[4:7])
        if command == 0x4C:
            return None if self.configuring or self.node != UNCONFIGURED else bytes([0x50])
        return self._configure(command, rest) if self.configuring else None

    def _select(self, part: int, number: int) -> bytes | None:
        if self.configuring:
            return None
        fits = self.identity.numbers[part] == number and self._matched == (part if part else self._matched)
        self._matched = part + 1 if fits else 0
        last = 1 if self._fault == "lss-early" else _LAST_PART
        if fits and part >= last:
            self.configuring, self._matched = True, 0
            return bytes([0x44])
        return None

    def _scan(self, number: int, bit: int, part: int, following: int) -> bytes | None:
        if self.configuring or self.node != UNCONFIGURED:
            return None
        if bit == 0x80:
            self._part = 0
            return bytes([0x4F])
        if bit > 31 or part > _LAST_PART or part != self._part or (self.identity.numbers[part] ^ number) >> bit:
            return None
        if bit == 0:
            self._part = following
            early = self._fault == "lss-early" and part == 1 and following == part + 1
            self.configuring = following < part or early
        return bytes([0x4F])

    def _configure(self, command: int, rest: bytes) -> bytes | None:
        if 0x5A <= command <= 0x5D:
            return bytes([command]) + self.identity.numbers[command - 0x5A].to_bytes(4, "little")
        if command == 0x5E:
            return bytes([command, self.node])
        if command == 0x11:
            valid = 1 <= rest[0] <= 127 or rest[0] == UNCONFIGURED
            self.pending = rest[0] if valid else self.pending
            return bytes([command, 0 if valid else _REFUSED])
        if command == 0x13:
            valid = rest[0] == 0 and rest[1] in _BIT_TIMINGS
            self.bit_timing = rest[1] if valid else self.bit_timing
            return bytes([command, 0 if valid else _REFUSED])
        if command == 0x17:
            self._memory.store({_NODE_KEY: self.pending, _BIT_KEY: self.bit_timing})
            return bytes([command, 0])
        return None


class LssDevice:
    """An actor: the slave, and the device that lives at its node id while it has one.

    build: node id → the device there and its endpoint, which is closed when it gets another id.
    """

    def __init__(
        self,
        slave: LssSlave,
        channel: Endpoint,
        clock: Clock,
        build: Callable[[int], tuple[Actor, Endpoint]],
        turnaround_s: float = 0.001,
    ) -> None:
        self.slave = slave
        self._channel, self._clock, self._build = channel, clock, build
        self._turnaround_s = turnaround_s
        self._agenda = Agenda()
        self._inner: tuple[Actor, Endpoint] | None = None
        self._start()

    def next_due_s(self) -> float:
        """When slave or device next does something by itself."""
        return min(self._agenda.next_s, self._inner[0].next_due_s() if self._inner else self._agenda.next_s)

    def act(self, now_s: float) -> None:
        """Answers the LSS master, obeys NMT's resets, lets the device live."""
        self._agenda.run(now_s)
        if len(frames := self._channel.receive(0.0)):
            for can_id, length, data in zip(frames.can_id.tolist(), frames.length.tolist(), frames.data, strict=True):
                if not can_id & (ERROR | REMOTE | EXTENDED):
                    self._hear(can_id, data[:length].tobytes(), now_s)
        if self._inner is not None:
            self._inner[0].act(now_s)

    def power_cycle(self) -> None:
        """Loses power and gets it back."""
        self._agenda.clear()
        self.slave.power_on()
        self._start()

    def _hear(self, can_id: int, data: bytes, now_s: float) -> None:
        slave = self.slave
        if can_id == _NMT and len(data) >= 2 and data[0] in _RESETS and data[1] in (0, slave.node):
            self._activate()
        if can_id != _MASTER:
            return
        for answer in slave.take(data):
            self._agenda.at(now_s + self._turnaround_s, partial(self._channel.send, _ANSWER, answer))
        if not slave.configuring and slave.node == UNCONFIGURED:
            self._activate()

    def _activate(self) -> None:
        if self.slave.pending != self.slave.node:
            self.slave.node = self.slave.pending
            self._start()

    def _start(self) -> None:
        if self._inner is not None:
            self._inner[1].close()
        node = self.slave.node
        self._inner = None if node == UNCONFIGURED else self._build(node)
