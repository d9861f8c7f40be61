"""A simulated PLC with its cell: the program that docs/line.md asks of a real one, and what can go wrong with it."""

from station.adapters.simulated_plc.faults import KINDS, PlcFaultSpec, parse_fault
from station.adapters.simulated_plc.loads import CellLoads, Handed
from station.adapters.simulated_plc.memory import MemoryRegisters
from station.adapters.simulated_plc.program import Motion, SimulatedPlc
from station.adapters.simulated_plc.remote_io import IO_KINDS, IoWiring, SimulatedRemoteIo, Taken

__all__ = [
    "IO_KINDS",
    "KINDS",
    "CellLoads",
    "Handed",
    "IoWiring",
    "MemoryRegisters",
    "Motion",
    "PlcFaultSpec",
    "SimulatedPlc",
    "SimulatedRemoteIo",
    "Taken",
    "parse_fault",
]
