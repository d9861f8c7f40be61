"""A line in the spectrum of the dwells that grows with the drive of the motors.

Each stop's samples are turned into one complex amplitude per frequency up to half the sample rate. Powers add up over
stops without regard to phase; where a narrow line stands out of the spectrum around it in proportion to motor², the
phases are followed over the whole campaign, which fixes frequency, amplitude and phase. A tone above half the rate
shows at its alias. Where the phases do not hold from stop to stop, amplitudes come from the powers alone
(`tone_power.py`). What dies away after each arrival is taken off first, and a line that the second half of the dwells
does not hold is none: it keeps step with the moves, a tone with the motors. Tones far below the noise of a dwell show
in the spectrum of all dwells together (`matched_spectrum.py`).
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from station.diagnosis.data.faults.gross_fault import BlockGain, FaultParameter, GrossFault, block_gain, halves_of
from station.diagnosis.data.faults.matched_spectrum import MatchedSpectrum
from station.diagnosis.data.faults.spectral_lines import OVERSAMPLING, PowerSpectrum, line_gains
from station.diagnosis.data.faults.tone_power import TonePower, power_per_visit
from station.domain.core.types import Array, Floats, SampleTable
from station.domain.recipe.recipe import Recipe

#: Nats of log-likelihood that a line must gain beyond the number of frequencies tried.
MIN_GAIN_NATS = 12.0
#: A unit needs so many stops before its arrivals can be told from its tones.
MIN_FILTER_VISITS = 8
#: What the second half of a dwell may hold less of a tone, in standard deviations, and the least share that it must.
LASTING_SIGMA, MIN_LASTING_SHARE = 3.0, 0.25
#: The least noise of an axis beside the noisiest one.
MIN_AXIS_NOISE = 0.1
#: Samples whose spectrum is taken at once.
SAMPLES_AT_ONCE = 50_000


@dataclass(frozen=True, slots=True, eq=False)
class TransientFilter:
    """What is taken off the samples of a stop: a cubic in time, and what each unit's dwells have in common, plainly
    and in proportion to the last move.

    curve (v, s, 4) powers of time, zero where there is no sample; step (v, 3) previous stop's mean less this one's;
    units: the stops of each unit that has enough of them.
    """

    curve: Floats
    step: Floats
    units: tuple[NDArray[np.intp], ...]

    def __call__(self, samples: Floats) -> Floats:
        """Samples (v, s, 3) without it. A wave goes through the same filter before it is compared with them."""
        across = self.curve.transpose(0, 2, 1)
        normal = across @ self.curve + 1e-9 * np.eye(4)
        out = samples - self.curve @ np.linalg.solve(normal, across @ samples)
        for stops in self.units:
            for axis in range(3):
                basis = np.linalg.qr(np.stack([np.ones(len(stops)), self.step[stops, axis]], 1))[0]
                out[stops, :, axis] -= basis @ (basis.T @ out[stops, :, axis])
        return np.asarray(out * (self.curve[:, :, :1] != 0))


@dataclass(frozen=True, slots=True, eq=False)
class WhiteDwells:
    """White, filtered samples (v, s, 3) of the stops, zero where there is none; the readings (v, s, 3) as they came;
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
    def middle_s(self) -> Floats:
        """Where each stop's phase is taken (v)."""
        return np.asarray(self.time_s[:, 0])


def white_dwells(table: SampleTable, stop: NDArray[np.intp], rate_hz: float) -> tuple[WhiteDwells, Floats]:
    """The stops' samples without their slow course, and the noise (3) of each axis."""
    first = np.flatnonzero(np.diff(stop, prepend=-1))
    length = np.diff(np.append(first, len(stop)))
    at = np.repeat(np.arange(len(first)), length), np.arange(len(stop)) - np.repeat(first, length)
    shape = (len(first), int(length.max()))
    reading, time, curve = np.zeros((*shape, 3)), np.zeros(shape), np.zeros((*shape, 4))
    reading[at], time[at] = table.reading, table.time_s + table.values["started_s"]
    share = (at[1] + 0.5) / np.repeat(length, length) * 2 - 1
    curve[at] = np.stack([share**k for k in range(4)], 1)
    clean = TransientFilter(curve, *_moves(table, first, length))
    flat = clean(reading)
    sigma = np.median(np.abs(flat[at]), axis=0) / 0.6745
    # An axis whose samples hardly ever differ has the others' scale.
    sigma = np.where(sigma > MIN_AXIS_NOISE * sigma.max(), sigma, sigma.max())
    motor = np.add.reduceat(table.values["motor"], first) / length
    return WhiteDwells(flat / np.maximum(sigma, 1e-300), reading, time, motor, rate_hz, clean), sigma


def _moves(
    table: SampleTable, first: NDArray[np.intp], length: NDArray[np.intp]
) -> tuple[Floats, tuple[NDArray[np.intp], ...]]:
    """The last move before each stop (v, 3), and the stops of each unit that has enough of them."""
    mean = np.add.reduceat(table.reading, first) / length[:, None]
    unit, run = table.unit.code[first], table.run[first]
    same = np.append(False, (unit[1:] == unit[:-1]) & (run[1:] == run[:-1]))[:, None]
    step = np.where(same, np.roll(mean, 1, axis=0) - mean, 0.0)
    stops = (np.flatnonzero((unit == code) & (length == length.max())) for code in np.unique(unit))
    return step, tuple(s for s in stops if len(s) >= MIN_FILTER_VISITS)


def faults(recipe: Recipe, table: SampleTable, stop: NDArray[np.intp]) -> list[GrossFault]:
    """The strongest line, if there is one that the motors explain."""
    needed = {"motor", "started_s"} <= set(table.values)
    if not needed or len(table) < 64 or float(np.ptp(table.values["motor"])) == 0.0:
        return []
    rate, samples = recipe.device.rate_hz, int(np.bincount(stop).max())
    if samples < 16:
        return []
    tried = np.arange(3, OVERSAMPLING * samples // 2) * rate / (OVERSAMPLING * samples)
    spectrum, matched = _power_spectrum(table, stop, rate, tried)
    gains = line_gains(spectrum)
    best = int(gains.argmax())
    coherent = matched.lines()
    significant = gains[best] >= MIN_GAIN_NATS + np.log(len(tried))
    if not significant and coherent is None:
        return []
    d, sigma = white_dwells(table, stop, rate)
    if coherent is not None and not (significant and gains[best] > coherent[1]):
        frequency, nats = _nearest_tone(d, coherent[0], matched.resolution_hz), coherent[1]
    else:
        frequency, nats = _refine_frequency(d, float(tried[best])), float(gains[best])
    tone = _tone(d, frequency)
    if not tone.lasts(d):
        return []
    fault = _fault(tone, d, sigma, nats, recipe)
    return [] if fault.rejected else [fault]


def _power_spectrum(
    table: SampleTable, stop: NDArray[np.intp], rate_hz: float, tried: Floats
) -> tuple[PowerSpectrum, MatchedSpectrum]:
    """The spectrum of all stops at frequencies tried in equal steps, some units after others; and that of all of them
    as one record."""
    t = table.time_s + table.values["started_s"]
    matched = MatchedSpectrum(rate_hz, float(tried[0]), float(t.min()), float(t.max()))
    power, weight, squares = np.zeros((len(tried), 3)), 0.0, 0.0
    starts = np.flatnonzero(np.diff(table.unit.code, prepend=-1))
    part = np.append(starts[np.diff(starts // SAMPLES_AT_ONCE, prepend=-1) > 0], len(stop))
    for first, last in pairwise(part):
        d, _ = white_dwells(table[first:last], stop[first:last] - stop[first], rate_hz)
        power += _power(d, tried)
        matched.add(d.white, d.time_s, d.motor, d.live)
        weight += float(np.sum(_weight(d)))
        squares += float(np.sum(_weight(d) ** 2))
    return PowerSpectrum(power / max(weight, 1e-300), weight**2 / max(squares, 1e-300)), matched


def _amplitudes(d: WhiteDwells, frequency_hz: float) -> Array:
    """Complex sums (v, 3) of the white samples against the wave."""
    wave = np.exp(-2j * np.pi * frequency_hz * (d.time_s - d.middle_s[:, None]))
    return np.asarray(np.einsum("vs,vsi->vi", wave, d.white))


def _power(d: WhiteDwells, tried: Floats) -> Floats:
    """Sum over the stops of their power (f, 3) at frequencies in equal steps, times their weight.

    Each wave is the one before, turned on by the step: sines are dearer than products.
    """
    late = 2 * np.pi * (d.time_s - d.middle_s[:, None])
    step = late * (tried[1] - tried[0] if len(tried) > 1 else 0.0)
    c, s, cos, sin = (f(x).astype(np.float32) for x in (late * tried[0], step) for f in (np.cos, np.sin))
    white = d.white.astype(np.float32)
    weight = (_weight(d) / np.maximum(_count(d), 1))[:, None]
    power = np.zeros((len(tried), 3))
    for i in range(len(tried)):
        both = np.stack([c, s], axis=1) @ white
        power[i] = np.sum(weight * np.sum(both.astype(float) ** 2, axis=1), axis=0)
        c, s = c * cos - s * sin, s * cos + c * sin
    return power


def _count(d: WhiteDwells) -> Floats:
    return np.asarray(np.count_nonzero(d.white[:, :, 0], axis=1), float)


def _weight(d: WhiteDwells) -> Floats:
    return np.asarray(d.motor**2 * _count(d))


def _refine_frequency(d: WhiteDwells, frequency_hz: float) -> float:
    """The frequency near a line at which the phases of all stops agree best."""
    resolution = d.rate_hz / (OVERSAMPLING * d.white.shape[1])
    base = _amplitudes(d, frequency_hz) * d.motor[:, None]
    at = d.middle_s - d.middle_s.mean()
    total = max(float(np.ptp(at)), 1e-9)
    shift = np.arange(-resolution, resolution, 0.25 / total)
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
    (2, 3) of one phase for all stops, bend (v, s, 3) by the frequency, and the power of each phase on its own."""

    frequency_hz: float
    waves: Floats
    c: Floats
    bend: Floats
    power: TonePower

    @property
    def coherent(self) -> bool:
        """Whether one phase holds for all stops."""
        return not self.power.exceeds(self.c)

    def lasts(self, d: WhiteDwells) -> bool:
        """Whether the second half of the dwells holds as much of it as the first: what an arrival leaves does not."""
        place = np.cumsum(d.live, axis=1) - 1
        late = (place >= _count(d)[:, None] / 2)[None, :, :, None]
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
        """What it gains at one half of the stops, found in the other; of a tone without a common phase the likelihood
        is averaged over the phase."""
        scores, counts = np.zeros(len(d.white)), _count(d)
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


def _nearest_tone(d: WhiteDwells, lines_hz: Floats, resolution_hz: float) -> float:
    """The frequency near one of some lines that has the largest amplitude, all samples at their own times."""
    step = resolution_hz * np.arange(-1, 1.01, 0.25)
    live, weight = d.live, np.broadcast_to(d.motor[:, None], d.live.shape)
    t, y = (d.time_s - d.time_s[live].mean())[live], (d.white * weight[..., None])[live]
    tried = (lines_hz[:, None] + step).ravel()
    power = [float(np.sum(np.abs(np.exp(-2j * np.pi * f * t) @ y) ** 2)) for f in tried]
    return float(tried[int(np.argmax(power))])


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
    """Amplitude of each axis and frequency where every stop has a phase of its own: the motors are not in step."""
    # What a unit's stops have in common mixes their phases: each stop stands for itself here.
    alone = replace(d.filter, units=())
    d = replace(d, white=alone(d.reading) / np.maximum(sigma, 1e-300), filter=alone)
    resolution = d.rate_hz / (OVERSAMPLING * d.white.shape[1])
    tried = frequency_hz + resolution * np.linspace(-1, 1, 41)
    frequency_hz = float(tried[np.argmax(_power(d, tried).sum(1))])
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
