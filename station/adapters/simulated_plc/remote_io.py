"""A simulated remote I/O with the cell at its wires: clamps that take time, and people who change units, press the
buttons and pull at every part they can."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

from station.errors import UsageError

#: kind → what happens, from the first load on.
IO_KINDS: Mapping[str, str] = MappingProxyType(
    {
        "silent": "takes requests and answers none",
        "clamp-stuck": "the clamp of nest 1 does not close",
        "clamp-loose": "the clamp of nest 1 opens by itself while units are tested",
        "part-pulled": "somebody pulls the unit of nest 1 out of its closed clamp before the rejects are acknowledged",
        "button-taped": "the button for the acknowledgement is held down for ever",
        "start-taped": "the start button is held down for ever",
    }
)
#: A clamp, a hand at a button and a hand at a part take so long, s.
CLAMP_S, PRESS_S, TAKE_S = 0.1, 0.3, 0.2


@dataclass(frozen=True, slots=True)
class IoWiring:
    """Which bit is wired to what, as the station's settings have it; nests by number from 0."""

    inputs_at: int
    outputs_at: int
    parts: Sequence[int]
    clamped: Sequence[int]
    clamps: Sequence[int]
    start: int
    acknowledge: int
    lamps: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class Taken:
    """A unit that left its nest. acknowledged: whether somebody had pressed the button for the rejects in this load."""

    load: int
    serial: str
    acknowledged: bool


@dataclass(slots=True)
class SimulatedRemoteIo:
    """Serves registers. coming: serials nest by nest, one load after the other; taken: what left the nests, in order;
    change_s: how long units are changed for."""

    wiring: IoWiring
    coming: Iterator[Sequence[str]]
    fault: str = ""
    change_s: float = 1.0
    nests: list[str] = field(default_factory=list)
    load: int = 0
    taken: list[Taken] = field(default_factory=list)
    _words: dict[int, int] = field(default_factory=dict)
    _open: dict[int, bool] = field(default_factory=dict)  # clamps as they really stand; none known: open
    _since_s: dict[str, float] = field(default_factory=dict)
    _clamped: bool = False
    _loose: bool = False
    _acknowledged: bool = False

    def __post_init__(self) -> None:
        if self.fault and self.fault not in IO_KINDS:
            raise UsageError("remote-io-fault-unknown", kind=self.fault[:40], kinds=sorted(IO_KINDS))
        self.nests = self.nests or [""] * len(self.wiring.parts)

    @property
    def lamps(self) -> frozenset[str]:
        """The lamps that are lit."""
        return frozenset(name for name, bit in self.wiring.lamps.items() if self._output(bit))

    def read(self, address: int, count: int, now_s: float) -> list[int]:
        """Words of the inputs, or the outputs as they were last written."""
        self.scan(now_s)
        return [self._word(address + i, now_s) for i in range(count)]

    def write(self, address: int, words: Sequence[int], now_s: float) -> None:
        """Sets words of the outputs."""
        for i, word in enumerate(words):
            self._words[address + i] = word
        self.scan(now_s)

    def wire_fault(self, _now_s: float) -> str:
        """What is wrong with the wire."""
        return "silent" if self.fault == "silent" and self.load else ""

    def scan(self, now_s: float) -> None:
        """Clamps follow their outputs, hands do what they can."""
        for place, bit in enumerate(self.wiring.clamps):
            wanted = self._output(bit)
            if self._after(f"clamp {place}", wanted is not self._open.get(place, True), CLAMP_S, now_s):
                self._open[place] = wanted or (self.fault == "clamp-stuck" and place == 0)
        closed = not any(self._open.get(place, True) for place, serial in enumerate(self.nests) if serial)
        self._clamped = self._clamped or (closed and any(self.nests))
        self._loose = self._loose or (self.fault == "clamp-loose" and self._after("loose", self._clamped, 0.5, now_s))
        if self._loose:
            self._open[0] = True
        self._acknowledged = self._acknowledged or self._acknowledge_down(now_s)
        for place, serial in enumerate(self.nests):
            self._pull(place, serial, now_s)
        if not any(self.nests):
            self._change(now_s)

    def _pull(self, place: int, serial: str, now_s: float) -> None:
        """Whoever can take a unit takes it: only a closed clamp keeps it where it is."""
        free = bool(serial) and self._clamped and self._open.get(place, True)
        torn = self.fault == "part-pulled" and place == 0 and bool(serial) and self._requested
        if self._after(f"take {place}", free or torn, TAKE_S, now_s):
            self.taken.append(Taken(self.load, serial, self._acknowledged))
            self.nests[place] = ""

    def _change(self, now_s: float) -> None:
        """The next load comes where every clamp is open."""
        everywhere = all(self._open.get(place, True) for place in range(len(self.nests)))
        if self._after("change", everywhere, self.change_s, now_s) and (serials := next(self.coming, None)) is not None:
            self.nests = [*serials, *[""] * (len(self.nests) - len(serials))]
            self.load += 1
            self._clamped = self._acknowledged = False

    @property
    def _requested(self) -> bool:
        """Whether the lamps ask for the acknowledgement."""
        return {"blue", "sound"} <= self.lamps and "flash" not in self.lamps

    def _start_down(self, now_s: float) -> bool:
        if self.fault == "start-taped":
            return True
        waits = any(self.nests) and not self._clamped
        return self._held("start", waits, now_s)

    def _acknowledge_down(self, now_s: float) -> bool:
        if self.fault == "button-taped":
            return True
        return self._held("acknowledge", self._requested and any(self.nests), now_s)

    def _held(self, button: str, wanted: bool, now_s: float) -> bool:
        """A button is up first, then down for a while, and up again."""
        began_s = self._begun(button, wanted, now_s)
        return began_s is not None and int((now_s - began_s) / PRESS_S) % 3 == 1

    def _after(self, what: str, wanted: bool, delay_s: float, now_s: float) -> bool:
        """Whether something has been wanted for so long; it then begins anew."""
        began_s = self._begun(what, wanted, now_s)
        if began_s is None or now_s - began_s < delay_s:
            return False
        del self._since_s[what]
        return True

    def _begun(self, what: str, wanted: bool, now_s: float) -> float | None:
        if not wanted:
            self._since_s.pop(what, None)
            return None
        return self._since_s.setdefault(what, now_s)

    def _word(self, address: int, now_s: float) -> int:
        at = address - self.wiring.inputs_at
        if not 0 <= at < 16:
            return self._words.get(address, 0)
        bits = [self.wiring.parts[place] for place, serial in enumerate(self.nests) if serial]
        bits += [bit for place, bit in enumerate(self.wiring.clamped) if not self._open.get(place, True)]
        bits += [self.wiring.start] * self._start_down(now_s) + [self.wiring.acknowledge] * self._acknowledge_down(
            now_s
        )
        return sum(1 << bit % 16 for bit in bits if bit // 16 == at)

    def _output(self, bit: int) -> bool:
        return bool(self._words.get(self.wiring.outputs_at + bit // 16, 0) >> bit % 16 & 1)
