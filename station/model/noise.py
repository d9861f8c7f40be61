"""Noise of a sensor: white by its data sheet, on a low floor of flicker."""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats

#: Flicker below half the inverse of this is drawn wave by wave; above it white noise is far larger.
FLICKER_STEP_S = 0.5


@dataclass(frozen=True, slots=True)
class Noise:
    """density: white, recipe's unit per √Hz; flicker: rms of the 1/f noise between 1 Hz and one wave a run."""

    density: float
    flicker: float

    def draw(self, time_s: Floats, rate_hz: float, rng: np.random.Generator) -> Floats:
        """Noise (n, 3) of the samples of a run at time_s (n); the bandwidth is half the rate."""
        slow = self.slow(float(time_s.max(initial=0.0)), rng)
        return np.asarray(self.white(len(time_s), rate_hz, rng) + flicker_at(slow, time_s))

    def white(self, samples: int, rate_hz: float, rng: np.random.Generator) -> Floats:
        """White noise (n, 3)."""
        return np.asarray(self.density * np.sqrt(rate_hz / 2) * rng.standard_normal((samples, 3)))

    def slow(self, span_s: float, rng: np.random.Generator) -> Floats:
        """Flicker (3, k) every half second of at least `span_s`: waves whose power falls as 1/f. It repeats."""
        size = 1 << max(3, int(np.ceil(np.log2(span_s / FLICKER_STEP_S + 2))))
        power = np.zeros(size // 2 + 1)
        power[1:] = 1 / np.arange(1, size // 2 + 1)
        waves = np.sqrt(power) * (rng.standard_normal((3, len(power))) + 1j * rng.standard_normal((3, len(power))))
        # The last wave of a real transform has no imaginary part and no mirror: a quarter of the others' power.
        rms = np.sqrt(4 * power.sum() - 3 * power[-1]) / size
        return np.asarray(np.fft.irfft(waves, size) * self.flicker / rms)


def flicker_at(slow: Floats, time_s: Floats) -> Floats:
    """Flicker (n, 3) at any time, between its points on a straight line."""
    place = time_s / FLICKER_STEP_S
    before = np.floor(place).astype(int)
    share = place - before
    points = slow.shape[1]
    return np.asarray((slow[:, before % points] * (1 - share) + slow[:, (before + 1) % points] * share).T)
