"""Devices on the bus. python-can comes first, without asammdf: canopen would import it with all it can use."""

from station.lean import without

with without("asammdf"):
    import can as can
