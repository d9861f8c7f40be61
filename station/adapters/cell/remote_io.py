"""A cell without a PLC, at a remote I/O over Modbus TCP: sensors, clamps, buttons, lamps and a sounder as bits."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from station.adapters.modbus import ModbusRegisters
from station.domain.cell.handover import CellView
from station.domain.cell.packml import State
from station.domain.cell.remote_cell import ClampPhase, RemoteCell, Signals
from station.domain.recipe.fields import Positive, StrictModel
from station.errors import ConfigError, InvalidValue, StationFault
from station.files.json_text import NOT_AS_EXPECTED, parse_json
from station.files.replace import replace_text
from station.messages import system_reason
from station.ports.clock import Clock
from station.ports.registers import Registers, Table

Bit = Annotated[int, Field(ge=0, le=255)]
Bits = Annotated[tuple[Bit, ...], Field(min_length=1, max_length=16)]
#: Where lamps and sounder are wired by default.
LAMPS = {"red": 8, "yellow": 9, "green": 10, "blue": 11, "white": 12, "sound": 13, "flash": 14}
_WORD = 16


class RemoteIoCell:
    """Clamps open only as `domain.cell.remote_cell` lets them; what it remembers is on the disk before a clamp moves. A
    clamp is closed without power: a station or a remote I/O that dies lets nothing go.

    line: {cell: {kind: remote-io, host: 192.168.0.40}}
    """

    class Settings(StrictModel):
        """host, port, device, answer_s: the remote I/O; table, inputs_at, outputs_at: where its words lie. Bits, from
        0: part sensors, closed clamps and clamp outputs (1 opens) in the order of the nests; two buttons; the lamps
        that there are. memory: file of what must outlive the process."""

        host: Annotated[str, Field(max_length=253, pattern=r"^[\w.:\-]*$")] = ""
        port: Annotated[int, Field(ge=1, le=65535)] = 502
        device: Annotated[int, Field(ge=0, le=247)] = 1
        answer_s: Positive = 0.3
        table: Table = "input"
        inputs_at: Annotated[int, Field(ge=0, le=65000)] = 0
        outputs_at: Annotated[int, Field(ge=0, le=65000)] = 512
        parts: Bits = (0, 1, 2, 3)
        clamped: Bits = (4, 5, 6, 7)
        clamps: Bits = (0, 1, 2, 3)
        start: Bit = 8
        acknowledge: Bit = 9
        lamps: dict[str, Bit] = Field(default_factory=lambda: dict(LAMPS))
        memory: Annotated[str, Field(min_length=1, max_length=4096)] = "cell-memory.json"

        @model_validator(mode="after")
        def _check(self) -> Self:
            if not len(self.parts) == len(self.clamped) == len(self.clamps):
                raise InvalidValue("remote-io-nests", counts=[len(self.parts), len(self.clamped), len(self.clamps)])
            for bits in ([*self.parts, *self.clamped, self.start, self.acknowledge], self._outputs):
                if len(set(bits)) < len(bits):
                    raise InvalidValue("remote-io-bit-twice", bit=next(b for b in bits if bits.count(b) > 1))
            return self

        @property
        def _outputs(self) -> list[int]:
            return [*self.clamps, *self.lamps.values()]

        @property
        def words_in(self) -> int:
            """Words of the inputs."""
            return max(*self.parts, *self.clamped, self.start, self.acknowledge) // _WORD + 1

        @property
        def words_out(self) -> int:
            """Words of the outputs."""
            return max(self._outputs) // _WORD + 1

    def __init__(self, settings: "RemoteIoCell.Settings", clock: Clock, registers: Registers | None = None) -> None:
        del clock  # its words carry no heartbeat: nothing here waits
        if registers is None and not settings.host:
            raise ConfigError("remote-io-without-host")
        self._given = settings
        self._io = registers or ModbusRegisters(settings.host, settings.port, settings.device, settings.answer_s)
        self._memory = Path(settings.memory)
        self._lamps: frozenset[str] = frozenset()
        self._cell = self._remembered()

    @property
    def places(self) -> int:
        """How many nests its bits are for."""
        return len(self._given.parts)

    def view(self) -> CellView:
        """The inputs, and what follows. Errors: PlcFault; StationFault where a unit is not held that must be."""
        signals = self._signals()
        before = self._cell or RemoteCell.found(signals)
        if fault := before.fault(signals):
            self._become(before)
            raise StationFault(fault)
        cell = before.after(signals)
        self._become(cell)
        ready = cell.phase is ClampPhase.TESTING
        return CellView(cell.load, ready, signals.parts, cell.taken, cell.bins)

    def accept(self, load: int) -> None:
        """Nothing to say: nobody listens but the clamps."""

    def give(self, load: int, bins: Mapping[int, int]) -> None:
        """Frees the good units, and the others when somebody has taken note of them."""
        if self._cell is not None:
            self._become(self._cell.given(load, bins))

    def show(self, state: State, lamps: frozenset[str]) -> None:
        """The lamps; a remote I/O has no place for the state."""
        del state
        self._lamps = lamps
        if self._cell is not None:
            self._put(self._cell)

    def close(self) -> None:
        """Ends the connection."""
        self._io.close()

    def _become(self, cell: RemoteCell) -> None:
        """On the disk first: a clamp that has opened must not close on another load's units after a crash."""
        if cell != self._cell:
            try:
                replace_text(self._memory, json.dumps(cell.document()), durable=True)
            except OSError as exc:
                raise StationFault("remote-io-unwritten", file=str(self._memory), reason=system_reason(exc)) from exc
            self._cell = cell
        self._put(cell)

    def _signals(self) -> Signals:
        given = self._given
        words = self._io.read(given.table, given.inputs_at, given.words_in)

        def high(bit: int) -> bool:
            return bool(words[bit // _WORD] >> bit % _WORD & 1)

        def places(bits: tuple[int, ...]) -> frozenset[int]:
            return frozenset(place for place, bit in enumerate(bits) if high(bit))

        return Signals(places(given.parts), places(given.clamped), high(given.start), high(given.acknowledge))

    def _put(self, cell: RemoteCell) -> None:
        """All outputs, each time: a remote I/O that started again has forgotten them."""
        given = self._given
        bits = [given.clamps[place] for place in cell.open_clamps(self.places)]
        bits += [given.lamps[lamp] for lamp in cell.lamps(self._lamps) if lamp in given.lamps]
        words = [sum(1 << bit % _WORD for bit in bits if bit // _WORD == word) for word in range(given.words_out)]
        self._io.write(given.outputs_at, words)

    def _remembered(self) -> RemoteCell | None:
        try:
            return RemoteCell.of(parse_json(self._memory.read_bytes()))
        except FileNotFoundError:
            return None
        except (OSError, *NOT_AS_EXPECTED) as exc:
            raise StationFault("remote-io-memory", file=str(self._memory)) from exc
