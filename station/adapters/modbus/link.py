"""One PLC as its map describes it: a view of all it says, and the signals that it is given."""

from collections.abc import Callable
from functools import partial
from typing import TypeVar

from station.domain.cell import plc_view, register_map
from station.domain.cell.plc_view import MODULUS, PlcView
from station.domain.cell.register_map import INPUTS, OUTPUTS, RegisterMap
from station.errors import PlcFault
from station.ports.clock import Clock
from station.ports.registers import Registers

Answer = TypeVar("Answer")


class PlcLink:
    """Reads and writes by name. What is written are levels and numbers, never edges: to write one again is harmless, so
    a request that was lost is made again until `patience_s` after the last one that was answered.

    stale_s: a heartbeat of the PLC that stands so long means that its program does. Errors: PlcFault.
    """

    def __init__(
        self, registers: Registers, plc: RegisterMap, clock: Clock, patience_s: float = 0.4, stale_s: float = 1.0
    ) -> None:
        self.map = plc
        self._registers, self._clock = registers, clock
        self._patience_s, self._stale_s = patience_s, stale_s
        self._inputs = register_map.span(plc.inputs.at, INPUTS)
        self._beat = 0
        self._heard: tuple[int, float] | None = None  # the PLC's heartbeat, and when it last changed

    def begin(self) -> PlcView:
        """The first view after a pause in which nobody listened; says the station's own protocol."""
        self._heard = None
        view = self.view()
        self.write(protocol=register_map.PROTOCOL)
        return view

    def view(self) -> PlcView:
        """Everything that the PLC says, of one instant. Errors: also of another protocol, and of a stale heartbeat."""
        read = partial(self._registers.read, self.map.inputs.table, self._inputs.start, len(self._inputs))
        words = self._patiently(read)
        view = plc_view.view(self.map, words)
        if fault := plc_view.protocol_fault(view):
            raise PlcFault(fault)
        self._check_heartbeat(view.heartbeat)
        return view

    def write(self, **signals: int | tuple[int, ...]) -> None:
        """Writes signals of the map's outputs, one request each; `load_done` is `load-done`."""
        for key, value in signals.items():
            address, words = self._place(key, value)
            self._patiently(partial(self._registers.write, address, words))

    def write_checked(self, **signals: int | tuple[int, ...]) -> None:
        """The same, and reads each back. Errors: also where the PLC took it and does not hold it."""
        self.write(**signals)
        for key, value in signals.items():
            address, words = self._place(key, value)
            if self._patiently(partial(self._registers.read, "holding", address, len(words))) != words:
                raise PlcFault("plc-write-lost", signal=key.replace("_", "-"))

    def beat(self) -> None:
        """The station's heartbeat: another number each time."""
        self._beat = self._beat % (MODULUS - 1) + 1
        self.write(heartbeat=self._beat)

    def close(self) -> None:
        """Ends the connection; the next call opens another."""
        self._registers.close()

    def _place(self, key: str, value: int | tuple[int, ...]) -> tuple[int, list[int]]:
        name = key.replace("_", "-")
        words = register_map.words_from(self.map, OUTPUTS[name][0], value if isinstance(value, tuple) else (value,))
        return self.map.outputs.at[name], words

    def _patiently(self, request: Callable[[], Answer]) -> Answer:
        until_s = self._clock.monotonic_s() + self._patience_s
        while True:
            try:
                return request()
            except PlcFault:
                if self._clock.monotonic_s() >= until_s:
                    raise
                self._clock.sleep(0.05)

    def _check_heartbeat(self, beat: int) -> None:
        now_s = self._clock.monotonic_s()
        if self._heard is None or self._heard[0] != beat:
            self._heard = beat, now_s
        elif now_s - self._heard[1] > self._stale_s:
            raise PlcFault("plc-heartbeat-stale", beat=beat, age_s=now_s - self._heard[1])
