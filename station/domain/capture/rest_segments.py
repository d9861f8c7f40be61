"""A raw recording, turned by hand → the stretches in which the part lay still."""

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats, Labels, SampleTable
from station.errors import SamplesError

#: Stillness is judged over this long, and a still stretch is at least as long.
WINDOW_S = 1.0
#: The quietest share of the windows shows the noise of a part at rest.
QUIET_SHARE = 0.05
#: A window moves when its standard deviation is above (1 + LOUDER/√n) times that noise: ten of its own deviations
#: at 100 readings, where n readings know a standard deviation to 1/√(2n).
MOTION_MARGIN = 10.0
#: This share of a window at either end may still move; a gap that short between stretches is none.
EDGE_SHARE = 0.2
#: Directions closer than this are one orientation.
SAME_ORIENTATION_DEG = 10.0


def find(time_s: Floats, reading: Floats) -> NDArray[np.int64]:
    """Still stretches (k, 2) of readings (n, 3): first row and one past the last, in order.

    A reading belongs to a still stretch when some window of WINDOW_S around it is as quiet as the recording can be.
    Errors: SamplesError when the recording is too short to tell.
    """
    window = _window(time_s)
    std = _moving_std(reading, window)
    quiet = np.quantile(std, QUIET_SHARE, axis=0) * (1 + MOTION_MARGIN / np.sqrt(window))
    still = (std <= quiet).all(axis=1)
    covered = np.cumsum(np.bincount(np.flatnonzero(still), minlength=len(reading) + 1))
    covered -= np.r_[np.zeros(window, np.int64), covered[:-window]]
    edge = np.flatnonzero(np.diff(np.r_[0, (covered[:-1] > 0).astype(np.int8), 0])).reshape(-1, 2)
    return _trimmed(edge, round(EDGE_SHARE * window))


def _trimmed(edge: NDArray[np.int64], short: int) -> NDArray[np.int64]:
    """Stretches (k, 2) joined over gaps of up to `short` rows, then without so many at either end."""
    apart = edge[1:, 0] - edge[:-1, 1] > short
    joined = np.stack([edge[np.r_[True, apart], 0], edge[np.r_[apart, True], 1]], axis=1)
    return np.asarray(joined + np.array([short, -short]))


def table(time_s: Floats, reading: Floats, stretches: NDArray[np.int64], unit: str, names: list[str]) -> SampleTable:
    """A samples table of one run with one visit a stretch, at positions called `names`."""
    length = stretches[:, 1] - stretches[:, 0]
    rows = np.concatenate([np.arange(a, b) for a, b in stretches])
    visit = np.repeat(np.arange(len(stretches), dtype=np.int32), length)
    known = list(dict.fromkeys(names))
    code = np.array([known.index(n) for n in names], np.int32)
    return SampleTable(
        unit=Labels((unit,), np.zeros(len(rows), np.int32)),
        run=np.zeros(len(rows), np.int32),
        visit=visit,
        position=Labels(tuple(known), code[visit]),
        time_s=time_s[rows],
        reading=reading[rows],
    )


def orientations(directions: Floats) -> NDArray[np.int64]:
    """Number of the orientation of each direction (k, 3): those within ALIKE_DEG of its first one are one."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    number = np.full(len(unit), -1)
    for i in range(len(unit)):
        if number[i] < 0:
            close = unit @ unit[i] > np.cos(np.deg2rad(SAME_ORIENTATION_DEG))
            number[close & (number < 0)] = number.max() + 1
    return number


def _window(time_s: Floats) -> int:
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    window = round(WINDOW_S / step) if step > 0 else 0
    if window < 8 or len(time_s) < 4 * window:
        raise SamplesError(
            f"a recording of {len(time_s)} readings is too short to find where it lies still; "
            f"record more than {4 * WINDOW_S:g} s at 8 readings a second or faster"
        )
    return window


def _moving_std(reading: Floats, window: int) -> Floats:
    """Standard deviations (n − window + 1, 3) over `window` readings from each row on."""
    x = reading - reading.mean(axis=0)
    zero = np.zeros((1, 3))
    sums, squares = np.cumsum(np.r_[zero, x], axis=0), np.cumsum(np.r_[zero, x**2], axis=0)
    mean = (sums[window:] - sums[:-window]) / window
    return np.asarray(np.sqrt(np.maximum((squares[window:] - squares[:-window]) / window - mean**2, 0.0)))
