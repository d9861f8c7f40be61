"""How well amplitudes, frequency and phase of a tone are known, in noise of any colour."""

from dataclasses import dataclass

import numpy as np
import scipy

from station.diagnosis.data.faults.phase_peaks import PhasePeaks, waves_of
from station.diagnosis.data.faults.tone_power import NEIGHBOURS, NORMAL_95, power_per_visit, without_tone
from station.diagnosis.data.faults.white_dwells import WhiteDwells
from station.domain.core.types import Array, Floats

#: Frequencies of a tone without a common phase that are looked at, how often, and in how many of the deviations found.
POINTS, LOOKS, NARROWER = 41, 3, 5.0
#: In shares of a dwell's resolution: by how much a wave's image at the negative frequency, and the slow course that is
#: taken off, move the top of a tone of few waves a dwell.
MOVED_SHARE = 1 / 32
#: Standard deviation of a phase of which nothing is known.
ANY_PHASE = float(np.pi / np.sqrt(3))


@dataclass(frozen=True, slots=True, eq=False)
class ToneErrors:
    """Standard deviations: amplitude (3), in units of the noise of a sample; frequency; phase (3), rad, as each axis
    shows it."""

    amplitude: Floats
    frequency_hz: float
    phase: Floats


def noise_around(d: WhiteDwells, frequency_hz: float, waves: Floats) -> Floats:
    """Variance (3) of the noise around a frequency beside that of white samples: where whole waves more or fewer fit in
    a dwell. waves (2, v, s, 3): of a tone there, which is taken off first."""
    resolution = d.rate_hz / d.white.shape[1]
    near = frequency_hz + resolution * np.array(NEIGHBOURS)
    near = near[(near > 1.5 * resolution) & (near < d.rate_hz / 2 - resolution / 2)]
    if not len(near):
        return np.ones(3)
    rest = without_tone(waves, d.white)
    found = [d.motor**2 @ np.abs(_turned(d, rest, f)) ** 2 for f in near.tolist()]
    return np.asarray(np.mean(found, axis=0) / max(float(np.sum(d.weight)), 1e-300))


def own_frequency(d: WhiteDwells, frequency_hz: float, reach_hz: float) -> tuple[float, float]:
    """The frequency within reach of one, of a tone with a phase of its own in each dwell, and its standard deviation:
    by its likelihood over all that it may be, the phases integrated out."""
    for _ in range(LOOKS):
        waves = waves_of(d, frequency_hz)
        noise2 = np.maximum(noise_around(d, frequency_hz, waves), 1e-300)
        size = power_per_visit(waves, d.white, noise2).amplitude / noise2
        tried = frequency_hz + reach_hz * np.linspace(-1, 1, POINTS)
        tried = tried[(tried > 0) & (tried <= d.rate_hz / 2)]
        nats = np.zeros(len(tried))
        for i, f in enumerate(tried.tolist()):
            along = size * d.motor[:, None] * np.abs(_turned(d, d.white, f))
            # log I₀ of large arguments, too.
            nats[i] = float(np.sum(np.log(np.asarray(scipy.special.i0e(along), float)) + along))
        weight = np.exp(nats - nats.max())
        weight /= weight.sum()
        frequency_hz = float(weight @ tried)
        step = 2 * reach_hz / (POINTS - 1)
        std = float(np.sqrt(weight @ (tried - frequency_hz) ** 2 + step**2 / 12))
        reach_hz = min(reach_hz, NARROWER * std)
    return frequency_hz, float(np.hypot(std, MOVED_SHARE * d.rate_hz / d.white.shape[1]))


def _turned(d: WhiteDwells, samples: Floats, frequency_hz: float) -> Array:
    """Sums (v, 3) of samples (v, s, 3) against the wave."""
    return np.asarray(np.einsum("vs,vsi->vi", np.exp(-2j * np.pi * frequency_hz * d.time_s), samples))


def driven_dwells(d: WhiteDwells) -> float:
    """How many dwells count, by their drive."""
    drive2 = d.motor**2
    return max(float(np.sum(drive2)) ** 2 / max(float(np.sum(drive2**2)), 1e-300), 1.0)


def noise_at(d: WhiteDwells, frequency_hz: float, waves: Floats, residual: Floats) -> Floats:
    """Variance (3) of the noise at a frequency beside that of white samples, by what the dwells scatter there.

    waves (2, v, s, 3) at amplitude 1; residual (v, s, 3): the samples without the tone.
    """
    turned = _turned(d, residual, frequency_hz)
    drive2 = d.motor**2
    # The fit of the tone takes its part of the scatter.
    energy = np.sum(waves**2, axis=(0, 1, 2)) * max(1 - 1 / driven_dwells(d), 1e-3)
    return np.asarray(drive2 @ np.abs(turned) ** 2 / np.maximum(energy, 1e-300))


def tone_errors(
    noise2: Floats, dwells: float, waves: Floats, c: Floats, by_frequency: tuple[Floats, Floats], peaks: PhasePeaks
) -> ToneErrors:
    """By least squares in noise of variance noise2 (3), known from so many dwells, over all peaks at which the tone may
    be.

    c (2, 3): coefficients of the waves; by_frequency: of what 1 Hz more changes, the energy (3) beside the waves, and
    the coefficients (2, 3) along them.
    """
    bend2, along = by_frequency
    known = float(scipy.special.stdtrit(max(2 * dwells - 3, 1.0), 0.975)) / NORMAL_95
    own = known * float(np.sqrt(np.sum(noise2 * bend2)) / max(float(np.sum(bend2)), 1e-300))
    size2 = np.maximum(np.sum(c**2, axis=0), 1e-300)
    usual = float(np.sum(noise2 * size2) / np.sum(size2))
    # Of a few peaks no root mean square says how far 95 % of them are.
    frequency = own + peaks.reach_hz(usual) / NORMAL_95
    amplitude = known * np.sqrt(noise2 / np.maximum(np.sum(waves**2, axis=(0, 1, 2)) / 2, 1e-300))
    # Another frequency is made up for by another phase at the start of the campaign.
    turn = (c[1] * along[0] - c[0] * along[1]) / size2
    phase = np.minimum(np.hypot(amplitude / np.sqrt(size2), turn * frequency), ANY_PHASE)
    return ToneErrors(amplitude, frequency, phase)
