"""What describes a product, as files: which adapters read DBC and EDS."""

from station.adapters.canopen.eds import load as read_dictionary
from station.adapters.dbc import read_layouts

__all__ = ["read_dictionary", "read_layouts"]
