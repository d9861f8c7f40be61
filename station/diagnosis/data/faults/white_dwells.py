"""Samples of the dwells without their slow course, white: what a tone is looked for in."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats, SampleTable

#: A unit needs so many visits before its arrivals can be told from its tones.
MIN_FILTER_VISITS = 8
#: The least noise of an axis beside the noisiest one.
MIN_AXIS_NOISE = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class TransientFilter:
    """What is taken off the samples of a visit: a cubic in time, and what each unit's dwells have in common, plainly
    and in proportion to the last move.

    curve (v, s, 4) powers of time, zero where there is no sample; step (v, 3) previous visit's mean less this one's;
    units: the visits of each unit that has enough of them.
    """

    curve: Floats
    step: Floats
    units: tuple[NDArray[np.intp], ...]

    def __call__(self, samples: Floats) -> Floats:
        """Samples (v, s, 3) without it. A wave goes through the same filter before it is compared with them."""
        across = self.curve.transpose(0, 2, 1)
        normal = across @ self.curve + 1e-9 * np.eye(4)
        out = samples - self.curve @ np.linalg.solve(normal, across @ samples)
        for visits in self.units:
            for axis in range(3):
                basis = np.linalg.qr(np.stack([np.ones(len(visits)), self.step[visits, axis]], 1))[0]
                out[visits, :, axis] -= basis @ (basis.T @ out[visits, :, axis])
        return np.asarray(out * (self.curve[:, :, :1] != 0))


@dataclass(frozen=True, slots=True, eq=False)
class WhiteDwells:
    """White, filtered samples (v, s, 3) of the visits, zero where there is none; the readings (v, s, 3) as they came;
    time (v, s) on the campaign's clock; motor (v); rate in Hz; the filter."""

    white: Floats
    reading: Floats
    time_s: Floats
    motor: Floats
    rate_hz: float
    filter: TransientFilter

    @property
    def live(self) -> NDArray[np.bool_]:
        """Where there is a sample (v, s)."""
        return np.asarray(self.filter.curve[:, :, 0] != 0)

    @property
    def count(self) -> Floats:
        """Samples of each visit (v)."""
        return np.asarray(np.count_nonzero(self.white[:, :, 0], axis=1), float)

    @property
    def weight(self) -> Floats:
        """How much each visit (v) counts: as a tone in proportion to motor would show in it."""
        return np.asarray(self.motor**2 * self.count)

    def filtered(self, wave: Floats) -> Floats:
        """A wave (v, s) at motor 1 as the filtered samples (v, s, 3) would hold it."""
        return self.filter(np.repeat((self.motor[:, None] * wave)[..., None], 3, axis=2))

    @property
    def middle_s(self) -> Floats:
        """Where each visit's phase is taken (v)."""
        return np.asarray(self.time_s[:, 0])


def white_dwells(table: SampleTable, visit: NDArray[np.intp], rate_hz: float) -> tuple[WhiteDwells, Floats]:
    """The visits' samples without their slow course, and the noise (3) of each axis."""
    first = np.flatnonzero(np.diff(visit, prepend=-1))
    length = np.diff(np.append(first, len(visit)))
    live = np.arange(int(length.max())) < length[:, None]
    reading, time = _by_visit(table.reading, live), _by_visit(table.time_s + table.values["started_s"], live)
    curve = np.zeros((*live.shape, 4))
    for n in np.unique(length).tolist():
        curve[length == n, :n] = _powers(n)
    clean = TransientFilter(curve, *_moves(table, first, length))
    flat = clean(reading)
    sigma = np.array([np.median(np.abs(flat[..., axis][live])) for axis in range(3)]) / 0.6745
    # An axis whose samples hardly ever differ has the others' scale.
    sigma = np.where(sigma > MIN_AXIS_NOISE * sigma.max(), sigma, sigma.max())
    motor = np.add.reduceat(table.values["motor"], first) / length
    return WhiteDwells(flat / np.maximum(sigma, 1e-300), reading, time, motor, rate_hz, clean), sigma


def _by_visit(values: Floats, live: NDArray[np.bool_]) -> Floats:
    """Values (n, …) of samples laid out (v, s, …) where there is one, zero where there is none."""
    if live.all():
        return values.reshape(*live.shape, *values.shape[1:])
    out = np.zeros((*live.shape, *values.shape[1:]))
    out[live] = values
    return out


def _powers(samples: int) -> Floats:
    """Powers (s, 4) of time over a dwell, from −1 to 1."""
    share = (np.arange(samples) + 0.5) / samples * 2 - 1
    return np.stack([share**k for k in range(4)], axis=1)


def _moves(
    table: SampleTable, first: NDArray[np.intp], length: NDArray[np.intp]
) -> tuple[Floats, tuple[NDArray[np.intp], ...]]:
    """The last move before each visit (v, 3), and the visits of each unit that has enough of them."""
    mean = np.add.reduceat(table.reading, first) / length[:, None]
    unit, run = table.unit.code[first], table.run[first]
    same = np.append(False, (unit[1:] == unit[:-1]) & (run[1:] == run[:-1]))[:, None]
    step = np.where(same, np.roll(mean, 1, axis=0) - mean, 0.0)
    visits = (np.flatnonzero((unit == code) & (length == length.max())) for code in np.unique(unit))
    return step, tuple(s for s in visits if len(s) >= MIN_FILTER_VISITS)
