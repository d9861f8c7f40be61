"""A line in the spectrum of the dwells that grows with the drive of the motors.

Each visit's samples are turned into one complex amplitude per frequency up to half the sample rate. Powers add up over
visits without regard to phase; where a narrow line stands out of the spectrum around it in proportion to motor², the
phases are followed over the whole campaign, which fixes frequency, amplitude and phase. A tone above half the rate
shows at its alias. Where the phases do not hold from visit to visit, amplitudes come from the powers alone
(`tone_power.py`). What dies away after each arrival is taken off first, and a line that the second half of the dwells
does not hold is none: it keeps step with the moves, a tone with the motors. Tones far below the noise of a dwell show
in the spectrum of all dwells together (`matched_spectrum.py`), where the dwells must agree in phase beyond what any
noise does (`phase_agreement.py`).
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from station.diagnosis.data.faults.gross_fault import BlockGain, FaultParameter, GrossFault, block_gain, halves_of
from station.diagnosis.data.faults.phase_agreement import POWER_TERMS, PhaseAgreement, chance
from station.diagnosis.data.faults.phase_peaks import PhasePeaks, phase_peaks, waves_of
from station.diagnosis.data.faults.shared_noise import independent
from station.diagnosis.data.faults.tone_errors import (
    ToneErrors,
    driven_dwells,
    noise_around,
    noise_at,
    own_frequency,
    tone_errors,
)
from station.diagnosis.data.faults.tone_power import TonePower, power_per_visit
from station.diagnosis.data.faults.tone_search import ToneExtent, ToneLine, ToneSearch
from station.diagnosis.data.faults.white_dwells import WhiteDwells, white_dwells
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe

#: Chance of any tone in noise, over all lines that were tried.
FALSE_TONES = 1e-4
#: Chance, in the dwells that do not overlap the strongest one, from which on that one alone makes the line.
ONE_DWELL = 1e-3
#: What the second half of a dwell may hold less of a tone, in standard deviations, and the least share that it must.
LASTING_SIGMA, MIN_LASTING_SHARE = 3.0, 0.25


def faults(recipe: Recipe, table: SampleTable, visit: NDArray[np.intp]) -> list[GrossFault]:
    """The strongest line that the motors explain. With few visits of unlike drive, the power of a line may not show
    that it grows with the drive; its phases may."""
    extent, rate_hz = ToneExtent.of(table, visit), recipe.device.rate_hz
    if extent is None or not extent.shows_tones:
        return []
    search = ToneSearch(rate_hz, extent.longest)
    search.add(table, visit, extent)
    if not (lines := search.lines()):
        return []
    d, sigma = white_dwells(table, visit, rate_hz)
    for line in lines:
        if (fault := _confirmed(line, d, sigma, recipe)) is not None:
            return [fault]
    return []


def _confirmed(line: ToneLine, d: WhiteDwells, sigma: Floats, recipe: Recipe) -> GrossFault | None:
    """The tone of a line; None where chance, an arrival or anything but the motors may have made it."""
    judged = independent(d, float(line.frequency_hz[-1]))
    if line.resolution_hz is None:
        agreement = PhaseAgreement(judged, np.inf)
        grown, elsewhere = agreement.power_follows_drive(float(line.frequency_hz[0]))
        if chance(grown, POWER_TERMS) * line.tried > FALSE_TONES or chance(elsewhere, POWER_TERMS) > ONE_DWELL:
            return None
        frequency, nats = float(line.frequency_hz[0]), line.nats
    else:
        agreement = PhaseAgreement(judged, 1 / line.resolution_hz)
        frequency, nats = _most_agreed(agreement, line.frequency_hz, line.resolution_hz)
        if chance(nats, agreement.terms) * line.tried > FALSE_TONES or not agreement.follows_drive(frequency):
            return None
        nats -= float(np.log(line.tried))
    # Stretches agree by themselves; beyond them all of the campaign may.
    tone = _tone(d, phase_peaks(d, frequency))
    if not tone.lasts(d):
        return None
    fault = _fault(tone, d, sigma, nats, recipe)
    return None if fault.rejected else fault


@dataclass(frozen=True, slots=True, eq=False)
class Tone:
    """A tone at a frequency: its waves (2, v, s, 3) at amplitude 1 as the filtered samples hold them, coefficients
    (2, 3) of one phase for all visits, errors of these, variance (3) of the noise around beside that of white samples,
    and the power of each phase on its own."""

    frequency_hz: float
    waves: Floats
    c: Floats
    errors: ToneErrors
    noise2: Floats
    power: TonePower

    @property
    def coherent(self) -> bool:
        """Whether one phase holds for all visits."""
        return not self.power.exceeds(self.c)

    def lasts(self, d: WhiteDwells) -> bool:
        """Whether the second half of the dwells holds as much of it as the first: what an arrival leaves does not."""
        place = np.cumsum(d.live, axis=1) - 1
        late = (place >= d.count[:, None] / 2)[None, :, :, None]
        if self.coherent:
            square, std = [], []
            for part in (~late, late):
                waves = self.waves * part
                square.append(float(np.sum(_amplitude(waves, d.white * part[0]) ** 2)))
                # The variance of a squared amplitude of six numbers, each known to 2/Σ waves².
                each = 3 / max(float(np.sum(waves[0] ** 2)), 1e-300)
                square[-1] -= 6 * each
                std.append(float(np.sqrt(4 * max(square[-1], 0.0) * each + 12 * each**2)))
        else:
            halves = [power_per_visit(self.waves * part, d.white * part[0], self.noise2) for part in (~late, late)]
            square = [float(p.square.sum()) for p in halves]
            std = [float(np.sqrt(np.sum(p.std**2))) for p in halves]
        # As much, but for chance; and more than a quarter of it in any case.
        less = square[0] - square[1] > LASTING_SIGMA * float(np.hypot(std[0], std[1]))
        return not less and square[1] > MIN_LASTING_SHARE * square[0]

    def held_out_gain(self, d: WhiteDwells) -> BlockGain | None:
        """What it gains at one half of the visits, found in the other; of a tone without a common phase the likelihood
        is averaged over the phase."""
        scores, counts = np.zeros(len(d.white)), d.count
        half = halves_of(len(scores))
        for part in (0, 1):
            fitted, judged = half != part, half == part
            if not fitted.any() or not judged.any():
                continue
            waves, white = self.waves[:, judged], d.white[judged]
            if self.coherent:
                predicted = np.einsum("kvsi,ki->vsi", waves, _amplitude(self.waves[:, fitted], d.white[fitted]))
                scores[judged] = 0.5 * np.sum(white**2 - (white - predicted) ** 2, axis=(1, 2))
            else:
                amplitude = power_per_visit(self.waves[:, fitted], d.white[fitted], self.noise2).amplitude
                along = np.sqrt(np.sum(np.einsum("kvsi,vsi->kvi", waves, white) ** 2, axis=0)) * amplitude
                energy = amplitude**2 * np.sum(waves**2, axis=(0, 2)) / 4
                # log I₀ of large arguments, too.
                log_i0 = np.log(np.asarray(scipy.special.i0e(along), float)) + along
                scores[judged] = np.sum(log_i0 - energy, axis=1)
        return block_gain(scores, counts, "sample")


def _most_agreed(agreement: PhaseAgreement, lines_hz: Floats, resolution_hz: float) -> tuple[float, float]:
    """The frequency near one of some lines on which the dwells agree most, with all samples at their own times, and by
    how many nats."""
    tried = (lines_hz[:, None] + resolution_hz * np.arange(-1, 1.01, 0.25)).ravel().tolist()
    found = [agreement.at(f) for f in tried]
    best = int(np.argmax(found))
    return tried[best], found[best]


def _tone(d: WhiteDwells, peaks: PhasePeaks) -> Tone:
    """The tone at the best of some peaks, by least squares on all samples."""
    frequency_hz = peaks.best_hz
    for _ in range(4):
        waves, angle = waves_of(d, frequency_hz), 2 * np.pi * frequency_hz * d.time_s
        c = _amplitude(waves, d.white)
        late = 2 * np.pi * d.time_s
        bend = d.filtered(late * np.cos(angle)) * c[0] - d.filtered(late * np.sin(angle)) * c[1]
        along = _amplitude(waves, bend)
        bend = bend - np.einsum("kvsi,ki->vsi", waves, along)
        residual = d.white - np.einsum("kvsi,ki->vsi", waves, c)
        frequency_hz += float(np.sum(bend * residual) / max(float(np.sum(bend**2)), 1e-300))
    noise2 = noise_at(d, frequency_hz, waves, residual)
    errors = tone_errors(noise2, driven_dwells(d), waves, c, (np.sum(bend**2, axis=(0, 1)), along), peaks)
    around2 = noise_around(d, frequency_hz, waves)
    return Tone(frequency_hz, waves, c, errors, around2, power_per_visit(waves, d.white, around2))


def _fault(tone: Tone, d: WhiteDwells, sigma: Floats, nats: float, recipe: Recipe) -> GrossFault:
    """Amplitude of each axis, frequency and phase."""
    gain = tone.held_out_gain(d)
    if not tone.coherent:
        return replace(_incoherent_fault(d, tone.frequency_hz, sigma, nats, recipe), gain=gain)
    c, errors = tone.c, tone.errors
    strong = int(np.argmax(np.hypot(*c) * sigma))
    phase = float(np.arctan2(c[1, strong], c[0, strong]) % (2 * np.pi))
    along = c[0] * np.cos(phase) + c[1] * np.sin(phase)
    numbers = [
        FaultParameter("amplitude", axis, "common", float(a), float(s), recipe.unit)
        for axis, a, s in zip("xyz", along * sigma, errors.amplitude * sigma, strict=True)
    ]
    numbers.append(FaultParameter("frequency", None, "common", tone.frequency_hz, errors.frequency_hz, "Hz"))
    numbers.append(FaultParameter("phase", None, "common", phase, float(errors.phase[strong]), "rad"))
    sentence = f"a tone of {tone.frequency_hz:.3f} Hz follows the motors"
    return GrossFault("motor-tone", "common", tuple(numbers), sentence, nats, gain=gain)


def _incoherent_fault(d: WhiteDwells, frequency_hz: float, sigma: Floats, nats: float, recipe: Recipe) -> GrossFault:
    """Amplitude of each axis and frequency where every visit has a phase of its own: the motors are not in step."""
    # What a unit's visits have in common mixes their phases: each visit stands for itself here.
    alone = replace(d.filter, units=())
    d = replace(d, white=alone(d.reading) / np.maximum(sigma, 1e-300), filter=alone)
    frequency_hz, frequency_std = own_frequency(d, frequency_hz, d.rate_hz / d.white.shape[1])
    waves = waves_of(d, frequency_hz)
    found = power_per_visit(waves, d.white, noise_around(d, frequency_hz, waves))
    numbers = [
        FaultParameter("amplitude", axis, "common", float(a), float(std), recipe.unit)
        for axis, a, std in zip("xyz", found.amplitude * sigma, found.amplitude_std * sigma, strict=True)
    ]
    numbers.append(FaultParameter("frequency", None, "common", frequency_hz, frequency_std, "Hz"))
    return GrossFault(
        "motor-tone", "common", tuple(numbers), f"a tone near {frequency_hz:.2f} Hz follows the motors", nats
    )


def _amplitude(waves: Floats, white: Floats) -> Floats:
    """Least-squares coefficients (2, 3) of two waves (2, v, s, 3) on each axis."""
    normal = np.einsum("kvsi,lvsi->ikl", waves, waves)
    projected = np.einsum("kvsi,vsi->ik", waves, white)
    return np.asarray(np.linalg.solve(normal, projected[..., None])[..., 0].T)
