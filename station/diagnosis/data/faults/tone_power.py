"""Amplitude of a tone whose phase nobody knows: from the power in each visit, less what the noise puts there.

Each visit's white samples are fitted by a sine and a cosine; the square of that amplitude is too large on the average
by the trace of the fit's covariance, which is taken off before the visits are averaged.
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats

#: Half of a 95 % interval in standard deviations.
NORMAL_95 = 1.96
#: Frequencies, in steps of a dwell's resolution from a tone's, at which the noise around it is measured.
NEIGHBOURS = (-2, -1, 1, 2)
#: Power that the agreed phase must leave unexplained, as a share and in standard errors, before phases are let free.
MISSED_SHARE, MISSED_SIGMA = 0.2, 5.0


@dataclass(frozen=True, slots=True, eq=False)
class TonePower:
    """square (3): the squared amplitude of each axis, in units of the noise of a sample; std (3) of it."""

    square: Floats
    std: Floats

    @property
    def amplitude(self) -> Floats:
        """Amplitude of each axis (3); 0 where the power is no more than the noise's."""
        return np.asarray(np.sqrt(np.maximum(self.square, 0.0)))

    @property
    def amplitude_std(self) -> Floats:
        """Standard deviation (3) of the amplitude of which 1.96 hold its 95 % interval, whose ends are the roots of
        those of its square: of a weak one the root is no straight line."""
        low, high = (np.sqrt(np.maximum(self.square + side * NORMAL_95 * self.std, 0.0)) for side in (-1, 1))
        return np.asarray(np.maximum(high - self.amplitude, self.amplitude - low) / NORMAL_95)

    def exceeds(self, agreed: Floats) -> bool:
        """Whether one phase for all visits, with coefficients (2, 3), misses much of the power."""
        missed = float(np.sum(self.square) - np.sum(agreed**2))
        return missed > MISSED_SHARE * float(np.sum(self.square)) and missed > MISSED_SIGMA * float(
            np.sqrt(np.sum(self.std**2))
        )


def power_per_visit(waves: Floats, white: Floats, noise2: Floats) -> TonePower:
    """From the waves (2, v, s, 3) at amplitude 1 as the samples (v, s, 3) would hold them, in noise whose variance (3)
    at that frequency is so many times that of white samples."""
    c, unit, size = _fits(waves, white)
    extra = unit * noise2
    square = np.where(size > 0, np.sum(c**2, axis=-1) - extra, 0.0)
    weight = size**2
    total = np.maximum(weight.sum(0), 1e-300)
    mean = (weight * square).sum(0) / total
    # The noise taken off is no better known than by its neighbours.
    variance = extra**2 * (1 + 1 / len(NEIGHBOURS)) + 2 * np.maximum(mean, 0.0) * extra
    return TonePower(mean, np.sqrt((weight**2 * variance).sum(0)) / total)


def without_tone(waves: Floats, white: Floats) -> Floats:
    """Samples (v, s, 3) less a tone that has a phase and an amplitude of its own in each visit and axis."""
    return np.asarray(white - np.einsum("kvsi,vik->vsi", waves, _fits(waves, white)[0]))


def _fits(waves: Floats, white: Floats) -> tuple[Floats, Floats, Floats]:
    """Coefficients (v, 3, 2) of the waves in each visit, the trace (v, 3) of their covariance in white noise, and the
    waves' energy (v, 3), 0 where there is next to none."""
    normal = np.einsum("kvsi,lvsi->vikl", waves, waves)
    projected = np.einsum("kvsi,vsi->vik", waves, white)
    size = np.trace(normal, axis1=-2, axis2=-1)
    live = size > 1e-3 * size.max()
    inverse = np.linalg.inv(np.where(live[..., None, None], normal, np.eye(2)))
    c = np.where(live[..., None], np.einsum("vikl,vil->vik", inverse, projected), 0.0)
    return c, np.trace(inverse, axis1=-2, axis2=-1), np.where(live, size, 0.0)
