"""What a perfect device reads of what it feels: the vector itself, or what its sensor kind makes of it."""

from functools import cache
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from station import plugins
from station.domain.core.types import Floats
from station.domain.recipe.blocks import DeviceSheet

SENSORS = "station.domain.recipe.sensors"


def known_units() -> tuple[str, ...]:
    """The units of all sensor kinds' readings."""
    kinds: list[Any] = list(plugins.load_all(SENSORS).values())
    return tuple(kind.unit for kind in kinds)


#: Step of the central difference, as a share of the stimulus: its error and rounding are both below 1e-9.
STEP = 1e-5


@runtime_checkable
class ConvertingSensor(Protocol):
    """What a kind adds whose readings are not the components of its stimulus, such as an inclinometer's angles.

    axes: how many readings it may have, the usual number first; conventions: definitions that its readings may follow
    (`device.convention`), the usual one first; methods: those that can calibrate it; unit_per_rad: how far a reading
    moves when the device is turned by one radian.
    """

    axes: ClassVar[tuple[int, ...]]
    conventions: ClassVar[tuple[str, ...]]
    methods: ClassVar[tuple[str, ...]]
    unit_per_rad: ClassVar[float]

    def truth(self, sheet: DeviceSheet, felt: Floats) -> Floats:
        """What a perfect device reads (…, 3) of vectors (…, 3) in its frame; 0 for an axis that it does not have."""


@cache
def converting_kind(kind: str) -> ConvertingSensor | None:
    """The kind as one that converts; None for a kind that reads the components of its stimulus."""
    found = plugins.load(SENSORS, kind)()
    return found if isinstance(found, ConvertingSensor) else None


def axis_count(kind: str, sheet: DeviceSheet) -> int:
    """How many readings the device has."""
    convert = converting_kind(kind)
    return 3 if convert is None else sheet.axes or convert.axes[0]


def perfect(kind: str, sheet: DeviceSheet, felt: Floats) -> Floats:
    """What a perfect device reads (…, 3) of what it feels (…, 3), both in the device's frame."""
    convert = converting_kind(kind)
    return felt if convert is None else convert.truth(sheet, felt)


def reading_changes(kind: str, sheet: DeviceSheet, felt: Floats, patterns: Floats) -> Floats:
    """What small changes (k, v, 3) of what is felt (v, 3) do to the readings (k, v, 3), to first order."""
    convert = converting_kind(kind)
    if convert is None or not len(patterns):
        return patterns
    step = STEP * np.linalg.norm(felt, axis=-1).max() / max(float(np.abs(patterns).max()), 1e-300)
    apart = convert.truth(sheet, felt + step * patterns) - convert.truth(sheet, felt - step * patterns)
    return np.asarray(apart / (2 * step))
