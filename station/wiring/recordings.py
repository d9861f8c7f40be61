"""Recorded CAN logs and their marks as files: which adapters read and write them."""

from station.adapters.annotations import find_marks_file, read_marks, write_marks
from station.adapters.bus import read_log, write_log

__all__ = ["find_marks_file", "read_log", "read_marks", "write_log", "write_marks"]
