"""Devices on the bus. python-can comes first, without asammdf: canopen would import it with all it can use."""

from station.optional_imports import hide_packages

with hide_packages("asammdf"):
    import can as can
