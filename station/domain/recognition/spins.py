"""Whether a gyroscope's steady stretches are the spins that tell its gains."""

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats
from station.domain.recognition import no_rest
from station.domain.recognition.recording import Recording
from station.errors import SamplesError

#: Stretches whose rates lie within this share of the fastest turn, or within so many times their noise, are of one.
ONE_RATE, OF_NOISE = 0.05, 2.0
#: The fastest turn but for single readings.
FASTEST = 0.995
#: At rest no gyroscope scatters by more, where its unit is known, deg/s.
SHAKEN_DEG_S = 5.0
#: Handling is steady for less than this share of its time, at fewer rates.
LEAST_STEADY, LEAST_RATES = 0.5, 3


def check(recording: Recording, edges: NDArray[np.int64], *, one_rate: bool) -> None:
    """Errors: SamplesError where the stretches (k, 2) are none, are all of one rate, which tells an offset and no gain
    (one_rate: that will do), or are chance in what was handled."""
    if not len(edges):
        raise no_rest.error_of(recording)
    file, stretches = recording.source, [recording.reading[a:b] for a, b in edges]
    share = sum(map(len, stretches)) / len(recording)
    rates = np.array([np.median(one, axis=0) for one in stretches])
    noise = float(np.median([np.linalg.norm(one.std(axis=0)) for one in stretches]))
    found = _rates(rates, max(ONE_RATE * _fastest(recording.reading), OF_NOISE * noise))
    if one_rate and found == 1:
        return
    if found == 1 and noise > SHAKEN_DEG_S and not recording.scale.inferred:
        share = 0.0
    if share < LEAST_STEADY and found < LEAST_RATES:
        raise SamplesError("no-spins", file=file, rest_percent=100 * share)
    if found == 1:
        duration_s = share * float(recording.time_s[-1])
        raise SamplesError("one-rate-only", file=file, rest_s=duration_s, stretches=len(stretches))


def _fastest(reading: Floats) -> float:
    """How far readings (n, 3) reach from their middle."""
    return float(np.quantile(np.linalg.norm(reading - np.median(reading, axis=0), axis=1), FASTEST))


def _rates(rates: Floats, apart: float) -> int:
    """How many rates (k, 3) lie farther than `apart` from each other."""
    found: list[Floats] = []
    for rate in rates:
        if all(np.linalg.norm(rate - other) > apart for other in found):
            found.append(rate)
    return len(found)
