"""DBC files → pure layouts of messages and signals."""

from station.adapters.dbc.layouts import read_layouts

__all__ = ["read_layouts"]
