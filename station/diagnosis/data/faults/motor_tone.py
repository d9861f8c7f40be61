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
from station.diagnosis.data.faults.spectral_lines import OVERSAMPLING
from station.diagnosis.data.faults.tone_power import TonePower, power_per_visit
from station.diagnosis.data.faults.tone_search import ToneExtent, ToneLine, ToneSearch, power
from station.diagnosis.data.faults.white_dwells import WhiteDwells, white_dwells
from station.domain.core.types import Array, Floats, SampleTable
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
    if line.resolution_hz is None:
        agreement = PhaseAgreement(d, np.inf)
        grown, elsewhere = agreement.power_follows_drive(float(line.frequency_hz[0]))
        if chance(grown, POWER_TERMS) * line.tried > FALSE_TONES or chance(elsewhere, POWER_TERMS) > ONE_DWELL:
            return None
        near = d.rate_hz / (OVERSAMPLING * d.white.shape[1])
        frequency, nats = _refine_frequency(d, float(line.frequency_hz[0]), near), line.nats
    else:
        agreement = PhaseAgreement(d, 1 / line.resolution_hz)
        frequency, nats = _most_agreed(agreement, line.frequency_hz, line.resolution_hz)
        if chance(nats, agreement.terms) * line.tried > FALSE_TONES or not agreement.follows_drive(frequency):
            return None
        nats -= float(np.log(line.tried))
        # Stretches agree by themselves; beyond them all of the campaign may.
        frequency = _refine_frequency(d, frequency, line.resolution_hz)
    tone = _tone(d, frequency)
    if not tone.lasts(d):
        return None
    fault = _fault(tone, d, sigma, nats, recipe)
    return None if fault.rejected else fault


def _amplitudes(d: WhiteDwells, frequency_hz: float) -> Array:
    """Complex sums (v, 3) of the white samples against the wave."""
    wave = np.exp(-2j * np.pi * frequency_hz * (d.time_s - d.middle_s[:, None]))
    return np.asarray(np.einsum("vs,vsi->vi", wave, d.white))


def _refine_frequency(d: WhiteDwells, frequency_hz: float, near_hz: float) -> float:
    """The frequency near a line at which the phases of all visits agree best."""
    base = _amplitudes(d, frequency_hz) * d.motor[:, None]
    at = d.middle_s - d.middle_s.mean()
    total = max(float(np.ptp(at)), 1e-9)
    shift = np.arange(-near_hz, near_hz, 0.25 / total)
    best = (0.0, -1.0)
    for part in np.array_split(shift, max(1, len(shift) * len(at) // 2_000_000)):
        turned = np.exp(-2j * np.pi * np.outer(part + frequency_hz, at)) @ base
        agree = np.abs(np.sum(turned**2, axis=1)) + np.sum(np.abs(turned) ** 2, axis=1)
        i = int(agree.argmax())
        best = max(best, (float(part[i]), float(agree[i])), key=lambda pair: pair[1])
    return frequency_hz + best[0]


@dataclass(frozen=True, slots=True, eq=False)
class Tone:
    """A tone at a frequency: its waves (2, v, s, 3) at amplitude 1 as the filtered samples hold them, coefficients
    (2, 3) of one phase for all visits, bend (v, s, 3) by the frequency, and the power of each phase on its own."""

    frequency_hz: float
    waves: Floats
    c: Floats
    bend: Floats
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
            halves = [power_per_visit(self.waves * part, d.white * part[0]) for part in (~late, late)]
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
                amplitude = power_per_visit(self.waves[:, fitted], d.white[fitted]).amplitude
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


def _tone(d: WhiteDwells, frequency_hz: float) -> Tone:
    """The tone near a frequency, by least squares on all samples."""
    for _ in range(4):
        angle = 2 * np.pi * frequency_hz * d.time_s
        waves = np.stack([_filtered(d, np.sin(angle)), _filtered(d, np.cos(angle))])
        c = _amplitude(waves, d.white)
        late = 2 * np.pi * (d.time_s - d.time_s.mean())
        bend = _filtered(d, late * np.cos(angle)) * c[0] - _filtered(d, late * np.sin(angle)) * c[1]
        residual = d.white - np.einsum("kvsi,ki->vsi", waves, c)
        frequency_hz += float(np.sum(bend * residual) / max(float(np.sum(bend**2)), 1e-300))
    return Tone(frequency_hz, waves, c, bend, power_per_visit(waves, d.white))


def _fault(tone: Tone, d: WhiteDwells, sigma: Floats, nats: float, recipe: Recipe) -> GrossFault:
    """Amplitude of each axis, frequency and phase."""
    gain = tone.held_out_gain(d)
    if not tone.coherent:
        return replace(_incoherent_fault(d, tone.frequency_hz, sigma, nats, recipe), gain=gain)
    c, waves, frequency_hz = tone.c, tone.waves, tone.frequency_hz
    strong = int(np.argmax(np.hypot(*c) * sigma))
    phase = float(np.arctan2(c[1, strong], c[0, strong]) % (2 * np.pi))
    along = c[0] * np.cos(phase) + c[1] * np.sin(phase)
    std = sigma / np.sqrt(max(float(np.sum(waves[0] ** 2)) / 3, 1e-300))
    numbers = [
        FaultParameter("amplitude", axis, "common", float(a), float(s), recipe.unit)
        for axis, a, s in zip("xyz", along * sigma, std, strict=True)
    ]
    # An axis that is not there has no noise.
    phase_std = std / np.maximum(sigma * np.hypot(*c), 1e-300)
    frequency_std = float(1 / np.sqrt(max(float(np.sum(tone.bend**2)), 1e-300)))
    numbers.append(FaultParameter("frequency", None, "common", frequency_hz, frequency_std, "Hz"))
    numbers.append(FaultParameter("phase", None, "common", phase, float(phase_std[strong]), "rad"))
    sentence = f"a tone of {frequency_hz:.3f} Hz follows the motors"
    return GrossFault("motor-tone", "common", tuple(numbers), sentence, nats, gain=gain)


def _incoherent_fault(d: WhiteDwells, frequency_hz: float, sigma: Floats, nats: float, recipe: Recipe) -> GrossFault:
    """Amplitude of each axis and frequency where every visit has a phase of its own: the motors are not in step."""
    # What a unit's visits have in common mixes their phases: each visit stands for itself here.
    alone = replace(d.filter, units=())
    d = replace(d, white=alone(d.reading) / np.maximum(sigma, 1e-300), filter=alone)
    resolution = d.rate_hz / (OVERSAMPLING * d.white.shape[1])
    tried = frequency_hz + resolution * np.linspace(-1, 1, 41)
    tried = tried[tried <= d.rate_hz / 2]
    frequency_hz = float(tried[np.argmax(power(d, tried).sum(1))])
    angle = 2 * np.pi * frequency_hz * d.time_s
    found = power_per_visit(np.stack([_filtered(d, np.sin(angle)), _filtered(d, np.cos(angle))]), d.white)
    numbers = [
        FaultParameter("amplitude", axis, "common", float(a), float(std), recipe.unit)
        for axis, a, std in zip("xyz", found.amplitude * sigma, found.amplitude_std * sigma, strict=True)
    ]
    numbers.append(FaultParameter("frequency", None, "common", frequency_hz, resolution / 10, "Hz"))
    return GrossFault(
        "motor-tone", "common", tuple(numbers), f"a tone near {frequency_hz:.2f} Hz follows the motors", nats
    )


def _filtered(d: WhiteDwells, wave: Floats) -> Floats:
    """A wave (v, s) at motor 1 as the filtered samples (v, s, 3) would hold it."""
    return d.filter(np.repeat((d.motor[:, None] * wave)[..., None], 3, axis=2))


def _amplitude(waves: Floats, white: Floats) -> Floats:
    """Least-squares coefficients (2, 3) of two waves (2, v, s, 3) on each axis."""
    normal = np.einsum("kvsi,lvsi->ikl", waves, waves)
    projected = np.einsum("kvsi,vsi->ik", waves, white)
    return np.asarray(np.linalg.solve(normal, projected[..., None])[..., 0].T)
