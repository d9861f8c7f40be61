"""Simulated machines around a station, each served in a process of its own until its time is over."""

import asyncio
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import Any

from station.adapters.cell.remote_io import RemoteIoCell
from station.adapters.modbus import load_map
from station.adapters.simulated_device import grbl
from station.adapters.simulated_device.grbl_port import GrblPort
from station.adapters.simulated_plc import CellLoads, IoWiring, SimulatedPlc, SimulatedRemoteIo, parse_fault
from station.adapters.simulated_plc.devices import PRINTER_FAULTS, serve_printer, serve_scanner
from station.adapters.simulated_plc.retentive import RetentiveFile
from station.adapters.simulated_plc.server import PlcServer
from station.config.rigs import load_rig
from station.errors import StationFault, UsageError
from station.messages import system_reason
from station.wiring.buses import named_bus
from station.wiring.line import coming_loads
from station.wiring.live_rig import LiveRig

Tell = Callable[[Mapping[str, Any]], None]
#: The maps as shipped.
_RIG, _CELL = "two-axis", "cell"


@dataclass(frozen=True, slots=True)
class CellOptions:
    """A cell around a simulated machine; see `station rig --help`."""

    nests: int = 4
    loads: int | None = None
    change_s: float = 1.0
    scanner_port: int | None = None
    memory: str | None = None


@dataclass(frozen=True, slots=True)
class Machine:
    """What is simulated and how; see `station rig --help`. bus: interface and channel; map: None: as shipped."""

    bus: tuple[str, str] = ("socketcan", "vcan1")
    host: str = "127.0.0.1"
    port: int = 0
    map: str | None = None
    labels: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    seconds: float | None = None
    cell: CellOptions = CellOptions()


def simulate_drives(machine: Machine, tell: Tell) -> None:
    """The drives of a rig on a CAN interface."""
    interface, channel = machine.bus
    live = LiveRig.open(machine.map or _RIG, named_bus(interface, channel), machine.faults)
    tell({"rig": live.rig.name, "axes": [a.name for a in live.rig.axes], "channel": channel})
    live.live(_until(machine.seconds))


def simulate_grbl(machine: Machine, tell: Tell) -> None:
    """A GRBL controller behind a pseudo-terminal."""
    fault = machine.faults[0] if machine.faults else ""
    if len(machine.faults) > 1 or fault not in ("", *grbl.FAULTS):
        raise UsageError("grbl-fault-unknown", faults=list(machine.faults), known=list(grbl.FAULTS))
    rig = load_rig(machine.map or _RIG)
    stub = grbl.GrblStub(min(axis.acceleration_deg_s2 for axis in rig.axes), fault)
    with GrblPort(stub) as port:
        tell({"grbl": port.name, "rig": rig.name})
        port.serve(_until(machine.seconds))


def simulate_plc(machine: Machine, tell: Tell) -> None:
    """A PLC with its cell, and a scanner of the labels in its nests."""
    cell = machine.cell
    loads = CellLoads(iter(()), cell.change_s)
    memory = RetentiveFile(Path(cell.memory)) if cell.memory else None
    if memory is not None:
        memory.restore(loads)
    rest = None if cell.loads is None else max(0, cell.loads - loads.load)
    loads.coming = coming_loads(rest, cell.nests, loads.load * cell.nests + 1)
    faults = [parse_fault(text) for text in machine.faults]
    plc = SimulatedPlc(load_map(machine.map or _CELL), faults=faults, loads=loads, nests=cell.nests)
    if memory is not None:
        plc.starts = memory.starts
    watch = _Watch(plc, loads, memory, tell)
    server = PlcServer(plc, watch.scan)
    _run(_serve_cell(machine, server, "plc", _labels_of(lambda: loads.nests), tell), machine)


def simulate_io(machine: Machine, tell: Tell) -> None:
    """A remote I/O as `cell: {kind: remote-io}` is wired by default, with a cell and a scanner of the labels in it."""
    cell, fault = machine.cell, machine.faults[0] if machine.faults else ""
    coming = coming_loads(cell.loads, cell.nests)
    device = SimulatedRemoteIo(wiring_of(RemoteIoCell.Settings(), cell.nests), coming, fault, cell.change_s)
    watch = _IoWatch(device, tell)
    server = PlcServer(device, watch.scan)
    _run(_serve_cell(machine, server, "io", _labels_of(lambda: device.nests), tell), machine)


def simulate_light(machine: Machine, tell: Tell) -> None:
    """A stack light with its sounder at a remote I/O; no units come."""
    simulate_io(replace(machine, cell=replace(machine.cell, loads=0)), tell)


def simulate_scanner(machine: Machine, tell: Tell) -> None:
    """A scanner that reads what it was given."""
    known: dict[str, str] = {}
    for text in machine.labels:
        nest, equals, label = text.partition("=")
        if not equals:
            raise UsageError("rig-label-form", text=text[:40])
        known[nest] = label
    _run(serve_scanner(machine.host, machine.port, known.get, lambda port: tell({"scanner": port})), machine)


def simulate_printer(machine: Machine, tell: Tell) -> None:
    """A label printer that tells what it would print."""
    wants = machine.faults[0] if machine.faults else ""
    if wants not in ("", *PRINTER_FAULTS):
        raise UsageError("printer-fault-unknown", kind=wants[:40], kinds=list(PRINTER_FAULTS))
    _run(serve_printer(machine.host, machine.port, tell, lambda port: tell({"printer": port}), wants), machine)


MACHINES: Mapping[str, Callable[[Machine, Tell], None]] = {
    "cia402": simulate_drives,
    "grbl": simulate_grbl,
    "plc": simulate_plc,
    "io": simulate_io,
    "light": simulate_light,
    "scanner": simulate_scanner,
    "printer": simulate_printer,
}


def _until(seconds: float | None) -> Callable[[], bool]:
    """Whether its time is not over."""
    end_s = inf if seconds is None else time.monotonic() + seconds
    return lambda: time.monotonic() < end_s


async def _serve_cell(
    machine: Machine, server: PlcServer, name: str, label_of: Callable[[str], str | None], tell: Tell
) -> None:
    """The server under its name, and the scanner of the labels where the cell has one."""
    jobs = [server.serve(machine.host, machine.port, lambda port: tell({name: port}))]
    if machine.cell.scanner_port is not None:
        scanner = serve_scanner(machine.host, machine.cell.scanner_port, label_of, lambda port: tell({"scanner": port}))
        jobs.append(scanner)
    await asyncio.gather(*jobs)


def _run(serving: Any, machine: Machine) -> None:
    with suppress(TimeoutError):
        try:
            asyncio.run(_limited(serving, machine.seconds))
        except OSError as exc:
            if isinstance(exc, TimeoutError):
                raise
            reason = system_reason(exc)
            raise StationFault("line-not-listening", host=machine.host, port=machine.port, reason=reason) from exc


async def _limited(serving: Any, seconds: float | None) -> None:
    await asyncio.wait_for(serving, seconds)


def _labels_of(nests: Callable[[], Sequence[str]]) -> Callable[[str], str | None]:
    """Nests by letter (A, B, …) or by number from 1."""

    def read(nest: str) -> str | None:
        place = int(nest) - 1 if nest.isdigit() else ord(nest[:1].upper() or "?") - ord("A")
        serials = nests()
        return (serials[place] or None) if 0 <= place < len(serials) else None

    return read


def wiring_of(given: RemoteIoCell.Settings, nests: int) -> IoWiring:
    """A remote I/O that is wired as the settings say, for the first so many nests."""
    bits = given.parts[:nests], given.clamped[:nests], given.clamps[:nests]
    return IoWiring(given.inputs_at, given.outputs_at, *bits, given.start, given.acknowledge, given.lamps)


class _IoWatch:
    """Tells what happens around a remote I/O: loads, units that leave, lamps."""

    def __init__(self, device: SimulatedRemoteIo, tell: Tell) -> None:
        self._device, self._tell = device, tell
        self._load, self._left, self._lamps = 0, 0, frozenset[str]()

    def scan(self, _now_s: float) -> None:
        """Looks after each scan."""
        device = self._device
        if device.load != self._load:
            self._load = device.load
            self._tell({"load": device.load, "serials": device.nests})
        while self._left < len(device.taken):
            taken = device.taken[self._left]
            self._left += 1
            self._tell({"left": taken.serial, "load": taken.load, "acknowledged": taken.acknowledged})
        if device.lamps != self._lamps:
            self._lamps = device.lamps
            self._tell({"lamps": sorted(self._lamps)})


class _Watch:
    """Tells what happens in the cell: loads, motions, lamps; and keeps retentive memory."""

    def __init__(self, plc: SimulatedPlc, loads: CellLoads, memory: RetentiveFile | None, tell: Tell) -> None:
        self._plc, self._loads, self._memory, self._tell = plc, loads, memory, tell
        self._handed, self._load, self._motions, self._lamps = len(loads.handed), loads.load, 0, -1

    def scan(self, _now_s: float) -> None:
        """Looks after each scan."""
        if self._memory is not None:
            self._memory.keep(self._loads)
        if self._loads.load != self._load:
            self._load = self._loads.load
            self._tell({"load": self._load, "serials": list(self._loads.nests)})
        while self._handed < len(self._loads.handed):
            handed = self._loads.handed[self._handed]
            self._handed += 1
            self._tell({"handed": handed.load, "serials": list(handed.serials), "bins": handed.bins})
        while self._motions < len(self._plc.motions):
            self._tell({"motion": self._plc.motions[self._motions].number})
            self._motions += 1
        if (lamps := self._plc.lamps) != self._lamps:
            self._lamps = lamps
            self._tell({"lamps": sorted(n for n, bit in self._plc.map.light.items() if lamps >> bit & 1)})
