"""The ellipsoid whose axes are those of the sensor, through readings of a stimulus of one magnitude."""

import numpy as np

from station.domain.core.types import Floats
from station.domain.recognition.quantities import spans


def axis_parallel(y: Floats) -> tuple[Floats, Floats] | None:
    """Centre and half axes (3) of the ellipsoid through points (v, 3), or None where they do not tell.

    It is fitted about the points' mean, which lies inside of it however far it is from zero: a compass beside iron.
    """
    middle = y.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((y - middle) ** 2, axis=1))))
    if len(y) < 6 or not size > 0:
        return None
    off = (y - middle) / size
    A = np.concatenate([off**2, off], axis=1)
    if np.linalg.cond(A) > 1e4:
        return None
    x = np.linalg.lstsq(A, np.ones(len(y)), rcond=None)[0]
    if np.any(x[:3] <= 0):
        return None
    centre = -x[3:] / (2 * x[:3])
    half = np.sqrt((1 + float(np.sum(x[:3] * centre**2))) / x[:3])
    return (middle + centre * size, half * size) if spans((off - centre) / half, np.zeros(3), 1.0) else None
