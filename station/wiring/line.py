"""The line around a bench: its cell, scanner and printer, as config.yaml names them, or a simulated cell."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from station import plugins
from station.adapters.cell.plc import PlcCell
from station.adapters.clock import SystemClock
from station.adapters.modbus import PlcLink
from station.adapters.simulated_plc import CellLoads, MemoryRegisters, SimulatedPlc, parse_fault
from station.config.documents import Document
from station.config.line import LineAdapterSettings, LineSettings
from station.config.settings import Settings, load_config
from station.domain.cell.handover import Entry, LoadJournal
from station.domain.cell.register_map import MOST_NESTS, RegisterMap
from station.errors import ConfigError
from station.messages import Message
from station.ports.cell import Cell, LabelPrinter, Scanner
from station.ports.clock import Clock
from station.service.load_journal import StoreLoadJournal
from station.wiring.bench import Bench
from station.wiring.driven_fixture import is_this_machine
from station.wiring.options import options_of
from station.wiring.run_order import RunOrder

#: Word for `line.cell.kind`: a cell of this process, its loads and its labels with it.
SIMULATED = "simulated"
CELLS, SCANNERS, PRINTERS = "station.adapters.cell", "station.adapters.scanner", "station.adapters.label_printer"


@dataclass(frozen=True, slots=True)
class LineParts:
    """What stands around the bench. clock: of the cell; simulated: the cell is, and its loads come to an end; notices:
    what a person should know before the first load."""

    settings: LineSettings
    cell: Cell
    scanner: Scanner
    printer: LabelPrinter | None
    clock: Clock
    simulated: bool
    notices: tuple[Message, ...] = ()


def open_line(bench: Bench, order: RunOrder, loads: int | None, faults: Sequence[str], opened: ExitStack) -> LineParts:
    """Opens everything around the bench. Errors: ConfigError, UsageError."""
    settings, document = load_config(order.config)
    if len(settings.nests) > MOST_NESTS:
        raise ConfigError("line-too-many-nests", count=len(settings.nests), limit=MOST_NESTS)
    if settings.line is None and not order.simulate:
        raise ConfigError("line-without-block")
    if settings.line is None or settings.line.cell.kind == SIMULATED:
        return _simulated(bench, settings, loads or 3, faults)
    line, part = settings.line, document.part("line")
    clock = SystemClock()
    cell: Cell = _built(CELLS, "cell", line.cell, part, clock)
    opened.callback(cell.close)
    places = getattr(cell, "places", len(settings.nests))
    if places != len(settings.nests):
        raise ConfigError("line-cell-places", places=places, nests=len(settings.nests))
    scanner: Scanner = _built(SCANNERS, "scanner", line.scanner, part)
    opened.callback(scanner.close)
    printer: LabelPrinter | None = _built(PRINTERS, "printer", line.printer, part) if line.printer else None
    return LineParts(line, cell, scanner, printer, clock, simulated=False, notices=_verdicts_leave(bench, line))


def _verdicts_leave(bench: Bench, line: LineSettings) -> tuple[Message, ...]:
    """Where simulated units get verdicts, and the cell may hand back real ones."""
    host = str(line.cell.options.get("host", ""))
    if not bench.simulated or is_this_machine(host):
        return ()
    return (Message("line-simulated-verdicts", host=host),)


def _built(package: str, block: str, given: LineAdapterSettings, document: Document, *ports: object) -> Any:
    made: Any = plugins.load(package, given.kind)
    return made(options_of(block, given.options, document, made.Settings), *ports)


def _simulated(bench: Bench, settings: Settings, loads: int, faults: Sequence[str]) -> LineParts:
    clock, plc_map = bench.station.clock, RegisterMap()
    nests = [nest.name for nest in settings.nests]
    journal = StoreLoadJournal(bench.station.store)
    past = LoadJournal.of(journal.entries())
    if past.open is not None:  # it went with the simulated cell that it was in
        journal.add(Entry(0, "lost", past.open.load, past.open.places))
    last = max(past.last or 0, past.open.load if past.open else 0)
    cell_loads = CellLoads(coming_loads(loads, len(nests), last * len(nests) + 1), load=last, taken=last)
    plc = SimulatedPlc(plc_map, faults=[parse_fault(text) for text in faults], loads=cell_loads, nests=len(nests))
    cell = PlcCell(PlcCell.Settings(host="simulated"), clock, PlcLink(MemoryRegisters(plc, clock), plc_map, clock))
    given = settings.line or LineSettings()
    own = {"starved_s": 2.0, "after_crash": "continue"}
    line = given.model_copy(update={k: v for k, v in own.items() if k not in given.model_fields_set})
    unused = [part for part in ("scanner", "printer") if part in given.model_fields_set]
    notices = tuple(Message("line-simulated-part", part=part) for part in unused)
    labels = _SimulatedLabels(cell_loads, nests)
    return LineParts(line, cell, labels, None, clock, simulated=True, notices=notices)


def coming_loads(count: int | None, nests: int, first: int = 1) -> Iterator[tuple[str, ...]]:
    """Loads of simulated units, numbered on; None: without end."""
    number, load = first, 0
    while count is None or load < count:
        yield tuple(f"SN{number + i:04d}" for i in range(nests))
        number, load = number + nests, load + 1


class _SimulatedLabels:
    """Reads the labels of the simulated units."""

    def __init__(self, loads: CellLoads, nests: Sequence[str]) -> None:
        self._loads, self._nests = loads, list(nests)

    def read(self, nest: str, timeout_s: float) -> str | None:  # noqa: ARG002 - a simulated label is read at once
        """The serial of the unit in that nest."""
        place = self._nests.index(nest)
        return self._loads.nests[place] or None if place < len(self._loads.nests) else None

    def close(self) -> None:
        """Nothing to let go of."""
