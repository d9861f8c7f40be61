"""Whether the dwells agree in the phase of a tone, judged by themselves: noise of any colour and size is no tone.

A dwell's complex amplitude A at a frequency, divided by the root of its samples, is noise plus u·c, u the drive times
that root. Of N amplitudes whose noise is Gaussian and alike, the share 1 − R² that the best c leaves has the
distribution Beta(N−1, 1), so that −(N−1)·ln(1 − R²) is exponential, whatever the noise is at that frequency; summed
over axes, and over stretches of the record that need not agree, it follows a gamma distribution of so many terms.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from station.diagnosis.data.faults.white_dwells import WhiteDwells
from station.domain.core.types import Array, Floats

#: Dwells of a stretch that say anything of their agreement.
LEAST_DWELLS = 4
#: Exponential terms of a likelihood ratio of three numbers, one an axis.
POWER_TERMS = 1.5
#: Growths of the power with the drive that are tried.
POWERS_TRIED = 61
#: Share of the power that is left at the least: rounding.
LEAST_LEFT = 1e-12


def chance(agreement: float, terms: float) -> float:
    """How often noise agrees by so many nats, of so many terms."""
    return float(scipy.special.gammaincc(terms, agreement))


def agreement(explained: Floats, amplitudes: Floats | float) -> Floats:
    """Nats by which amplitudes agree, of which a share R² is explained by one phase."""
    return np.asarray((1 - amplitudes) * np.log(np.maximum(1 - explained, LEAST_LEFT)))


class PhaseAgreement:
    """The dwells of a campaign, in stretches in which the motors' phase is to hold."""

    def __init__(self, d: WhiteDwells, stretch_s: float) -> None:
        """Dwells, and how long a stretch is."""
        self._live = d.live
        self._first = np.append(0, np.cumsum(np.count_nonzero(self._live, axis=1))[:-1])
        self._time, self._white = d.time_s[self._live], d.white[self._live]
        begin = d.middle_s
        self._stretch = ((begin - begin.min()) / stretch_s).astype(np.intp)
        self._drive, self._count, self._begin_s = d.motor, np.maximum(d.count, 1.0), begin
        self._dwell_s = float(d.count.max(initial=0.0)) / d.rate_hz
        #: What the dwells of a unit have in common is taken off them: two numbers each.
        self._taken = np.zeros(len(begin))
        for visits in d.filter.units:
            self._taken[visits] = 2 / len(visits)

    @property
    def terms(self) -> int:
        """Exponential terms of the sum."""
        return 3 * len(self._stretches)

    @property
    def _stretches(self) -> list[NDArray[np.bool_]]:
        """The dwells (v) of each stretch that has enough of them, and not all at rest."""
        each = (self._stretch == k for k in range(int(self._stretch.max()) + 1))
        return [s for s in each if np.count_nonzero(s) - self._taken[s].sum() >= LEAST_DWELLS and self._drive[s].any()]

    def at(self, frequency_hz: float) -> float:
        """By how many nats the dwells agree on a tone of a frequency that grows with the drive."""
        return self._agreement(self._amplitudes(frequency_hz), self._drive)

    def follows_drive(self, frequency_hz: float) -> bool:
        """Whether they agree more on it than on a tone that is as strong at any drive."""
        amplitude = self._amplitudes(frequency_hz)
        return self._agreement(amplitude, self._drive) > self._agreement(amplitude, np.ones_like(self._drive))

    def power_follows_drive(self, frequency_hz: float) -> tuple[float, float]:
        """Nats (Gamma's, of 3/2 terms by Wilks' theorem) by which power that grows with the square of the drive is
        likelier, in any phase, than power that does not, powers of noise being exponential: of all dwells, and of those
        that do not overlap the strongest one, in which the bench alone may have been shaken."""
        power = np.abs(self._amplitudes(frequency_hz)) ** 2
        strongest = self._begin_s[int(np.argmax(power.sum(axis=1)))]
        others = np.abs(self._begin_s - strongest) > self._dwell_s
        return self._growth_nats(power, self._expected2), self._growth_nats(power[others], self._expected2[others])

    @staticmethod
    def _growth_nats(power: Floats, expected2: Floats) -> float:
        """By how many nats powers (v, 3) follow what a tone adds to them, in proportion (v)."""
        if not len(power):
            return 0.0
        growth = np.append(0.0, np.geomspace(1e-2, 1e4, POWERS_TRIED)) / max(float(expected2.max()), 1e-300)
        shape = 1 + growth[:, None, None] * expected2[:, None]
        level = np.log(np.mean(power / shape, axis=1)) + np.mean(np.log(shape), axis=1)
        return float(np.sum(len(power) * (level[0] - level.min(axis=0))))

    @property
    def _expected2(self) -> Floats:
        """What a tone adds to the power of each dwell, in proportion (v)."""
        return np.asarray(self._drive**2 * self._count)

    def _amplitudes(self, frequency_hz: float) -> Array:
        """Amplitude (v, 3) of each dwell, over the root of its samples."""
        turned = np.exp(-2j * np.pi * frequency_hz * self._time)[:, None] * self._white
        return np.asarray(np.add.reduceat(turned, self._first) / np.sqrt(self._count)[:, None])

    def _agreement(self, amplitude: Array, drive: Floats) -> float:
        expected, found = drive * np.sqrt(self._count), 0.0
        for s in self._stretches:
            common = np.abs(expected[s] @ amplitude[s]) ** 2 / np.sum(expected[s] ** 2)
            share = common / np.maximum(np.sum(np.abs(amplitude[s]) ** 2, axis=0), 1e-300)
            found += float(np.sum(agreement(share, np.count_nonzero(s) - float(self._taken[s].sum()))))
        return found
