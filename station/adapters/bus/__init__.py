"""CAN buses, one file each: a real interface, a recording, a simulated one; and CAN logs as files."""

from station.adapters.bus._candump import are_frames
from station.adapters.bus._logs import read_blocks, read_log, write_log

__all__ = ["are_frames", "read_blocks", "read_log", "write_log"]
