"""The units of one load as values of the bank's places."""

from collections.abc import Mapping

import numpy as np

from station.domain.core.types import Floats
from station.domain.watch.bank import LoadValues, WatchedPlace
from station.domain.watch.signals import WatchedSignal

#: Positions and the base are the same for all nests: only their mean over the nests is watched.
_COMMON = ("base-tilt", "index-error")


def load_values(number: int, nests: Mapping[str, Mapping[WatchedSignal, Floats]], all_nests: int) -> LoadValues:
    """nests: the signals of the unit in each nest. all_nests: how many nests the station has; with one, its own values
    are all there is."""
    values: dict[WatchedPlace, Floats] = {}
    by_signal: dict[WatchedSignal, list[Floats]] = {}
    for nest, signals in nests.items():
        for signal, found in signals.items():
            by_signal.setdefault(signal, []).append(found)
            if signal.kind not in _COMMON:
                values[WatchedPlace(signal, nest)] = found
    for signal, parts in by_signal.items():
        if signal.kind in _COMMON or all_nests > 1:
            values[WatchedPlace(signal)] = np.mean(parts, axis=0)
    return LoadValues(number, values)
