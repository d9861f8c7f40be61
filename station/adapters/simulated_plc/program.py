"""The program of a simulated PLC: one scan reads the station's words, moves the fixture, and publishes its own."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from station.adapters.simulated_plc.drive import TurningFixture
from station.adapters.simulated_plc.faults import AT_OFFER, BEFORE_OFFER, OF_LOADS, PlcFaultSpec
from station.adapters.simulated_plc.loads import CellLoads
from station.domain.cell import plc_view, register_map
from station.domain.cell.plc_view import BEATS_PER_S, MODULUS, SCALE, MoveState
from station.domain.cell.register_map import INPUTS, OUTPUTS, RegisterMap
from station.domain.core import rotation
from station.domain.core.types import Floats

#: A station whose heartbeat stands so long is gone, s; a go that is so many beats old is an old one.
STATION_LOST_S, GO_BEATS = 0.5, 5
#: The station sees a move done before what disturbs the next one begins, s.
PAUSE_S = 0.1
#: The quaternion of the parked fixture.
HOME: tuple[int, ...] = (SCALE, 0, 0, 0)
#: Fault codes of a move.
CODE_REFUSED, CODE_OLD_GO, CODE_UNSAFE, CODE_STATION_LOST = 1, 3, 4, 5


@dataclass(slots=True)
class Motion:
    """One motion as it really was. until_s: when it stood again."""

    number: int
    target: tuple[int, ...]
    began_s: float
    until_s: float


class SimulatedPlc:
    """Registers by address; `scan` brings everything up to an instant. motions: what the fixture really did.

    loads: the cell around it, None: parts lie in every nest and stay there.
    """

    def __init__(
        self,
        plc: RegisterMap,
        speed_deg_s: float = 90.0,
        acceleration_deg_s2: float = 180.0,
        faults: Sequence[PlcFaultSpec] = (),
        loads: CellLoads | None = None,
        nests: int = 4,
    ) -> None:
        self.map, self.loads = plc, loads
        self.motions: list[Motion] = []
        self.starts = 1
        self._nests, self._faults = nests, faults
        self._drive = TurningFixture.at_rest(speed_deg_s, acceleration_deg_s2)
        self._words: dict[int, int] = {}
        self._late_writes: list[tuple[float, int, list[int]]] = []
        self._offered_s: list[float] = []
        self._measured: tuple[tuple[float, ...], tuple[int, ...]] = (), HOME
        self._writes, self._scanned = 0, (-1.0, 0)
        self._restarted: set[PlcFaultSpec] = set()
        self._forgotten = False
        self._forget()

    def _forget(self) -> None:
        """Working memory as at power-on."""
        self._number, self._target, self._before = 0, HOME, HOME
        self._state, self._code, self._heard, self._heard_s = MoveState.IDLE, 0, 0, -1e9
        for name in OUTPUTS:
            kind, count = OUTPUTS[name]
            for i in range(count * register_map.WORDS[kind]):
                self._words[self.map.outputs.at[name] + i] = 0

    def wire_fault(self, now_s: float) -> str:
        """What is wrong with the connection at this instant: killed, silent, late, slow, dropped, exception, garbage;
        '' for nothing."""
        kinds = ("killed", "silent", "late", "slow", "dropped", "exception", "garbage")
        return next((kind for kind in kinds if self.active(kind, now_s)), "")

    def read(self, address: int, count: int, now_s: float) -> list[int]:
        """Registers as a request at `now_s` finds them."""
        self.scan(now_s)
        return [self._words.get(address + i, 0) for i in range(count)]

    def write(self, address: int, words: Sequence[int], now_s: float) -> None:
        """What a request at `now_s` writes; inputs are the PLC's own and stay."""
        self.scan(now_s)
        if self.active("frozen", now_s) or self.active("go-delayed", now_s):
            self._late_writes.append((now_s, address, list(words)))
            return
        outputs = register_map.span(self.map.outputs.at, OUTPUTS)
        lost = self.active("write-lost", now_s)
        for i, word in enumerate(words):
            if address + i in outputs and not (lost and address + i in self._places("target")):
                self._words[address + i] = word
        self._writes += 1
        self.scan(now_s)

    def _places(self, name: str) -> range:
        kind, count = OUTPUTS[name]
        return range(self.map.outputs.at[name], self.map.outputs.at[name] + count * register_map.WORDS[kind])

    def active(self, kind: str, now_s: float) -> bool:
        """Whether a fault of that kind is there at this instant."""
        return any(f.kind == kind and self._is_active(f, now_s) for f in self._faults)

    def _is_active(self, fault: PlcFaultSpec, now_s: float) -> bool:
        begins_s = self._begins_s(fault)
        return begins_s is not None and begins_s <= now_s and (not fault.seconds or now_s < begins_s + fault.seconds)

    def _begins_s(self, fault: PlcFaultSpec) -> float | None:
        """When a fault begins; None: not yet."""
        if fault.kind in OF_LOADS:
            return 0.0 if self.loads is not None and self.loads.load >= fault.at else None
        if fault.at == 0:
            return 0.0
        before = fault.kind in BEFORE_OFFER  # there when the move is offered: from the end of the one before on
        offers, motions = (len(self._offered_s), self.motions)
        if before:
            if fault.at == 1:
                return 0.0
            return motions[fault.at - 2].until_s + PAUSE_S if len(motions) >= fault.at - 1 else None
        if fault.kind in AT_OFFER:
            return self._offered_s[fault.at - 1] if offers >= fault.at else None
        return motions[fault.at - 1].began_s + fault.after_s if len(motions) >= fault.at else None

    @property
    def lamps(self) -> int:
        """The word of the stack light as the station wrote it."""
        return self._number_of("light")

    def restart(self, now_s: float) -> None:
        """Power off and on: the drive stands, working memory is empty; what is retentive stays."""
        self._stand(now_s)
        self.starts += 1
        self._forget()

    def scan(self, now_s: float) -> None:
        """One cycle; nothing is new where neither time nor a word has changed."""
        if (now_s, self._writes) == self._scanned:
            return
        self._scanned = now_s, self._writes
        self._drive_on(now_s)
        for fault in self._faults:
            if fault.kind == "restarted" and fault not in self._restarted and self._is_active(fault, now_s):
                self._restarted.add(fault)
                self.restart(now_s)
        if self.wire_fault(now_s) == "killed":
            self._stand(now_s)  # no voltage, no motion
            return
        if self.active("frozen", now_s):
            self._stand(now_s)  # the drive watches the program
            return
        self._take_late_writes(now_s)
        self._listen(now_s)
        self._handshake(now_s)
        self._cell(now_s)
        self._publish(now_s)

    def _take_late_writes(self, now_s: float) -> None:
        if self.active("go-delayed", now_s):
            due = [w for w in self._late_writes if now_s - w[0] >= 2.0]
        else:
            due = list(self._late_writes)
        for entry in due:
            self._late_writes.remove(entry)
            for i, word in enumerate(entry[2]):
                self._words[entry[1] + i] = word

    def _listen(self, now_s: float) -> None:
        if (beat := self._number_of("heartbeat")) != self._heard:
            self._heard, self._heard_s = beat, now_s

    def _handshake(self, now_s: float) -> None:
        fresh = now_s - self._heard_s <= STATION_LOST_S
        wanted = self._number_of("move")
        if wanted not in (0, self._number) and not self.active("ignores-offer", now_s):
            self._offer(wanted, now_s, fresh)
        if (
            self._number
            and self._number_of("stop") == self._number
            and self._state
            in (
                MoveState.OFFERED,
                MoveState.MOVING,
            )
        ):
            self._end(MoveState.STOPPED, 0, now_s)
        if self._state is MoveState.OFFERED and self._number_of("go") == self._number:
            self._start(now_s, fresh)
        if self._state is MoveState.MOVING:
            self._watch(now_s, fresh)

    def _offer(self, number: int, now_s: float, fresh: bool) -> None:
        self._stand(now_s)
        self._offered_s.append(now_s)
        self._before, self._target = self._target, self._numbers_of("target")
        self._number = number
        valid = abs(float(np.linalg.norm(np.array(self._target) / SCALE)) - 1) < 1e-3
        ok = valid and fresh and self._number_of("protocol") == register_map.PROTOCOL and self._safe(now_s)
        refused = not ok or self.active("refused", now_s)
        self._state, self._code = (MoveState.REFUSED, CODE_REFUSED) if refused else (MoveState.OFFERED, 0)

    def _start(self, now_s: float, fresh: bool) -> None:
        if self.active("never-starts", now_s):
            return
        if plc_view.beats_since(self._beat(now_s), self._number_of("go-beat")) > GO_BEATS or not fresh:
            self._end(MoveState.STOPPED, CODE_OLD_GO, now_s)
        elif not self._safe(now_s):
            self._end(MoveState.STOPPED, CODE_UNSAFE, now_s)
        else:
            slower = 1e9 if self.active("stuck", now_s) else 1000.0 if self.active("crawls", now_s) else 1.0
            goal = rotation.from_quaternion(np.array(self._target, float))
            self._drive.start(goal, now_s, slower)
            self._state = MoveState.MOVING
            self.motions.append(Motion(self._number, self._target, now_s, self._drive.arrives_s))

    def _watch(self, now_s: float, fresh: bool) -> None:
        if not self._safe(now_s):
            self._end(MoveState.STOPPED, CODE_UNSAFE, now_s)
        elif not fresh:
            self._end(MoveState.STOPPED, CODE_STATION_LOST, now_s)
        elif not self._drive.moving(now_s) or self.active("done-early", now_s):
            self._state = MoveState.DONE

    def _end(self, state: MoveState, code: int, now_s: float) -> None:
        self._stand(now_s)
        self._state, self._code = state, code

    def _stand(self, now_s: float) -> None:
        if self._drive.moving(now_s):
            self._drive.stop(now_s)
            self.motions[-1].until_s = now_s
            if self._state is MoveState.MOVING:
                self._state, self._code = MoveState.STOPPED, CODE_STATION_LOST

    def _drive_on(self, now_s: float) -> None:
        """Between two scans nobody looks at the PLC, but its own watch of the station goes on."""
        lost_s = self._heard_s + STATION_LOST_S
        if now_s > lost_s and self._drive.moving(lost_s):
            self._end(MoveState.STOPPED, CODE_STATION_LOST, lost_s)

    def _safe(self, now_s: float) -> bool:
        return {"safety-ok", "door-closed", "clamps-closed"} <= self._flags(now_s)

    def _cell(self, now_s: float) -> None:
        if self.loads is not None:
            if self.active("load-forgotten", now_s) and not self._forgotten:
                self.loads.load, self.loads.taken, self._forgotten = 1, 0, True
            self.loads.scan(now_s, self._number_of("load-done"), self._number_of("bins"))

    def _flags(self, now_s: float) -> set[str]:
        flags = {"safety-ok", "door-closed", "clamps-closed"}
        flags -= {"door-closed"} if self.active("door-open", now_s) or self.active("door-opened", now_s) else set()
        flags -= {"clamps-closed"} if self.active("clamp-open", now_s) or self.active("clamp-opened", now_s) else set()
        flags -= {"safety-ok"} if self.active("safety-tripped", now_s) else set()
        if self.loads is not None and not self.loads.nests:
            flags -= {"clamps-closed"}
        return flags

    def attitude(self, now_s: float) -> Floats:
        """Where the fixture really is."""
        return self._drive.attitude(now_s)

    def attitudes(self, times_s: Floats) -> Floats:
        """Where it really was (n, 3, 3) at instants (n) from the last move on."""
        return self._drive.attitudes(times_s)

    def _actual(self, now_s: float) -> tuple[int, ...]:
        """The encoders' quaternion; at rest it stays as it is."""
        key = (self._drive.began_s, self._drive.arrives_s, min(now_s, self._drive.arrives_s))
        if key != self._measured[0]:
            self._measured = key, plc_view.quaternion_of(self._drive.attitude(now_s))
        return self._measured[1]

    def _beat(self, now_s: float) -> int:
        return int(now_s * BEATS_PER_S) % MODULUS

    def _publish(self, now_s: float) -> None:
        flags, moving = self._flags(now_s), self._drive.moving(now_s)
        unasked = self.active("moves-unasked", now_s)
        flags |= {"moving"} if (moving and not self.active("done-early", now_s)) or unasked else {"in-position"}
        loads = self.loads
        flags |= {"load-ready"} if loads is not None and (loads.ready or self.active("load-repeated", now_s)) else set()
        word = register_map.pack_bits(self.map.status, frozenset(flags))
        word |= 1 << 15 if self.active("unknown-bits", now_s) else 0
        present = (1 << self._nests) - 1 if loads is None else loads.present
        present &= ~1 if self.active("part-removed", now_s) else 0xFFFF
        stale = self.active("heartbeat-stale", now_s)
        given: dict[str, int | tuple[int, ...]] = {
            "protocol": 2 if self.active("other-protocol", now_s) else register_map.PROTOCOL,
            "starts": self.starts % MODULUS,
            "status": word,
            "fault": self._code,
            "move-echo": (self._number + 7) % MODULUS if self.active("other-number", now_s) else self._number,
            "move-state": int(self._state),
            "target-echo": self._target_echo(now_s),
            "actual": self._actual(now_s),
            "present": present,
            **self._load_reports(now_s),
        }
        if not stale:
            given["heartbeat"] = self._beat(now_s)
        for name, value in given.items():
            kind, _ = INPUTS[name]
            words = register_map.words_from(self.map, kind, value if isinstance(value, tuple) else (value,))
            self._words.update({self.map.inputs.at[name] + i: word for i, word in enumerate(words)})

    def _load_reports(self, now_s: float) -> dict[str, int | tuple[int, ...]]:
        if self.loads is None:
            return {"load": 0, "load-taken": 0, "bins-taken": 0}
        bins = self.loads.bins_taken ^ (3 if self.active("bins-differ", now_s) else 0)
        taken = self.loads.load if self.active("taken-unasked", now_s) else self.loads.taken
        return {"load": self.loads.load, "load-taken": taken, "bins-taken": bins}

    def _target_echo(self, now_s: float) -> tuple[int, ...]:
        if self.active("stale-echo", now_s):
            return self._before
        if self.active("wrong-target", now_s) or (self.active("echo-changes", now_s) and self.motions):
            return (*self._target[:3], self._target[3] + 12345)
        return self._target

    def _numbers_of(self, name: str) -> tuple[int, ...]:
        kind, _ = OUTPUTS[name]
        return register_map.numbers_of(self.map, kind, [self._words.get(at, 0) for at in self._places(name)])

    def _number_of(self, name: str) -> int:
        return self._numbers_of(name)[0]
