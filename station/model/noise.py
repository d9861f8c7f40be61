"""Noise of a sensor: white by its data sheet, on a low floor of flicker."""

from dataclasses import dataclass

import numpy as np

from station.domain.types import Floats

#: Flicker below this is drawn wave by wave; above it white noise is far larger.
FLICKER_STEP_S = 0.5


@dataclass(frozen=True, slots=True)
class Noise:
    """density: white, recipe's unit per √Hz; flicker: rms of the 1/f noise between 1 Hz and one wave a run."""

    density: float
    flicker: float

    def draw(self, time_s: Floats, rate_hz: float, rng: np.random.Generator) -> Floats:
        """Noise (n, 3) of samples at time_s (n), which never runs back; the bandwidth is half the rate."""
        white = self.density * np.sqrt(rate_hz / 2) * rng.standard_normal((len(time_s), 3))
        return np.asarray(white + self._slow(time_s, rng))

    def _slow(self, time_s: Floats, rng: np.random.Generator) -> Floats:
        """Flicker (n, 3): waves whose power falls as 1/f."""
        start = float(time_s.min(initial=0.0))
        span = float(time_s.max(initial=0.0)) - start
        size = 1 << max(3, int(np.ceil(np.log2(span / FLICKER_STEP_S + 2))))
        power = np.zeros(size // 2 + 1)
        power[1:] = 1 / np.arange(1, size // 2 + 1)
        waves = np.sqrt(power) * (rng.standard_normal((3, len(power))) + 1j * rng.standard_normal((3, len(power))))
        # The last wave of a real transform has no imaginary part, hence half the weight.
        rms = np.sqrt(4 * power.sum() - 3 * power[-1]) / size
        grid = start + FLICKER_STEP_S * np.arange(size)
        slow = np.fft.irfft(waves, size) * self.flicker / rms
        return np.stack([np.interp(time_s, grid, axis) for axis in slow], axis=1)
