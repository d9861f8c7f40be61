"""When something between two visits can have happened: after the end of one and before the beginning of the next."""

import numpy as np

from station.diagnosis.data.reduce import NODES
from station.diagnosis.data.residuals import ResidualView
from station.domain.core.types import Array, Floats


def middles(view: ResidualView, visits: Array | slice) -> Floats:
    """The middle of each gap (k) between the chosen visits, s, as their mean times follow each other: of a long visit
    beside a short one that is not the middle of these. Where visits of several runs overlap, it is."""
    mean = np.round(view.scene.time_s[visits], 3)
    # A block reaches beyond its outermost nodes as Gauss and Legendre placed them.
    nodes = view.reduced.fine.time_s.reshape(len(view.scene.time_s), -1, len(NODES))[visits]
    middle, reach = nodes.mean(axis=2), np.ptp(nodes, axis=2) / np.ptp(NODES) * np.sqrt(3)
    times, place = np.unique(mean, return_inverse=True)
    begin, end = np.full(len(times), np.inf), np.full(len(times), -np.inf)
    np.minimum.at(begin, place, (middle - reach).min(axis=1))
    np.maximum.at(end, place, (middle + reach).max(axis=1))
    ended, begins = np.maximum.accumulate(end)[:-1], np.minimum.accumulate(begin[::-1])[::-1][1:]
    return np.where(ended <= begins, (ended + begins) / 2, (times[1:] + times[:-1]) / 2)
