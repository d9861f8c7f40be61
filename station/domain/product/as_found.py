"""The calibration that a device held before and after it was written, out of the bytes in its record."""

from collections.abc import Iterable, Mapping
from typing import Any, Literal

from station.domain.core.types import Floats
from station.domain.product import writeback
from station.domain.product.device_map import DeviceMap
from station.errors import UnitFault

#: Bytes before the first write, and those read back after the last.
Moment = Literal["old", "read_back"]


def held_calibration(
    device_map: DeviceMap, writes: Iterable[Mapping[str, Any]], moment: Moment
) -> tuple[Floats, Floats] | None:
    """(offset (3), matrix (3, 3)) of measured = matrix · true + offset. writes: rows of the record, in order.

    None where the device keeps no calibration, or the record does not hold all of it as numbers.
    """
    if not device_map.writes:
        return None
    raws: dict[tuple[int, int], bytes] = {}
    for write in writes:
        if not write.get(moment):
            continue
        index, _, sub = str(write["object"]).partition(":")
        at, raw = (int(index, 16), int(sub or "0", 16)), bytes.fromhex(write[moment])
        if moment == "old":
            raws.setdefault(at, raw)
        else:
            raws[at] = raw
    try:
        return writeback.decode(device_map, raws)
    except UnitFault:
        return None
