"""What describes a product, as files: which adapters read DBC and EDS."""

from station.adapters.canopen.eds import load as read_dictionary
from station.adapters.canopen.eds import titles as object_titles
from station.adapters.dbc import read_layouts
from station.adapters.dbc.other_formats import FORMATS as OTHER_FORMATS

__all__ = ["OTHER_FORMATS", "object_titles", "read_dictionary", "read_layouts"]
