"""A PLC brings loads and takes them back (docs/line.md): numbers of loads that only grow, and bins that it echoes."""

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field

from station.adapters.modbus import ModbusRegisters, PlcLink, load_map
from station.domain.cell import handover, register_map
from station.domain.cell.handover import CellView
from station.domain.cell.packml import State
from station.domain.recipe.fields import Positive, StrictModel
from station.errors import ConfigError
from station.ports.clock import Clock


class PlcCell:
    """The clamps open when the PLC holds the bins of the load in them, and not before.

    line: {cell: plc, host: 192.168.0.10, map: cell}
    """

    class Settings(StrictModel):
        """host, port, map: the PLC and its registers (`cells/NAME.yaml`); answer_s: longest for one answer."""

        host: Annotated[str, Field(max_length=253, pattern=r"^[\w.:\-]*$")] = ""
        port: Annotated[int, Field(ge=1, le=65535)] = 502
        map: Annotated[str, Field(max_length=4096, pattern=r"^[^\x00-\x1f\x7f]*$")] = "cell"
        answer_s: Positive = 0.3

    def __init__(self, settings: "PlcCell.Settings", clock: Clock, link: PlcLink | None = None) -> None:
        plc = load_map(settings.map)
        if link is None and not settings.host:
            raise ConfigError("cell-without-host")
        self._link = link or PlcLink(
            ModbusRegisters(settings.host, settings.port, plc.device, settings.answer_s), plc, clock
        )
        self._shown: tuple[State, frozenset[str]] | None = None
        self._starts: int | None = None

    def view(self) -> CellView:
        """What the PLC says now; the station's heartbeat goes with it."""
        view = self._link.begin()
        self._link.beat()
        if view.starts != self._starts:  # a PLC that starts again has forgotten what it was shown
            self._starts, shown, self._shown = view.starts, self._shown, None
            if shown is not None:
                self.show(*shown)
        return CellView(
            load=view.load,
            ready="load-ready" in view.status,
            present=view.present,
            taken=view.load_taken,
            bins_taken=handover.unpack_bins(view.bins_taken),
        )

    def accept(self, load: int) -> None:
        """Tells it that the load stands in the journal."""
        self._link.write(load_accepted=load)

    def give(self, load: int, bins: Mapping[int, int]) -> None:
        """The bins first, and the number of the load they are for only when they were read back."""
        self._link.write_checked(bins=handover.pack_bins(bins))
        self._link.write(load_done=load)

    def show(self, state: State, lamps: frozenset[str]) -> None:
        """State and lamps, where they have changed."""
        if self._shown != (state, lamps):
            self._link.write(state=int(state), light=register_map.pack_bits(self._link.map.light, lamps))
            self._shown = state, lamps

    def close(self) -> None:
        """Ends the connection."""
        self._link.close()
