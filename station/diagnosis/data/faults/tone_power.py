"""Amplitude of a tone whose phase nobody knows: from the power in each visit, less what the noise puts there.

Each visit's white samples are fitted by a sine and a cosine; the square of that amplitude is too large on the average
by the trace of the fit's covariance, which is taken off before the visits are averaged.
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats

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
        """Standard deviation (3) of the amplitude, by its slope; of a weak one that of the smallest seen."""
        return np.asarray(self.std / (2 * np.maximum(self.amplitude, np.sqrt(self.std))))

    def exceeds(self, agreed: Floats) -> bool:
        """Whether one phase for all visits, with coefficients (2, 3), misses much of the power."""
        missed = float(np.sum(self.square) - np.sum(agreed**2))
        return missed > MISSED_SHARE * float(np.sum(self.square)) and missed > MISSED_SIGMA * float(
            np.sqrt(np.sum(self.std**2))
        )


def power_per_visit(waves: Floats, white: Floats) -> TonePower:
    """From the waves (2, v, s, 3) at amplitude 1 as the samples (v, s, 3) would hold them."""
    normal = np.einsum("kvsi,lvsi->vikl", waves, waves)
    projected = np.einsum("kvsi,vsi->vik", waves, white)
    size = np.trace(normal, axis1=-2, axis2=-1)
    live = size > 1e-3 * size.max()
    inverse = np.linalg.inv(np.where(live[..., None, None], normal, np.eye(2)))
    c = np.einsum("vikl,vil->vik", inverse, projected)
    extra = np.trace(inverse, axis1=-2, axis2=-1)
    square = np.where(live, np.sum(c**2, axis=-1) - extra, 0.0)
    weight = np.where(live, size, 0.0) ** 2
    total = np.maximum(weight.sum(0), 1e-300)
    mean = (weight * square).sum(0) / total
    variance = extra**2 + 2 * np.maximum(mean, 0.0) * extra
    return TonePower(mean, np.sqrt((weight**2 * variance).sum(0)) / total)
