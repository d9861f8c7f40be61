"""Modbus TCP: one client, and what the positioner and the cell share of a PLC."""

from station.adapters.modbus.client import ModbusRegisters
from station.adapters.modbus.link import PlcLink
from station.adapters.modbus.maps import load_map

__all__ = ["ModbusRegisters", "PlcLink", "load_map"]
