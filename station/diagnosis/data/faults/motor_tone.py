"""A line in the spectrum of the dwells that grows with the drive of the motors.

Each stop's samples are turned into one complex amplitude per frequency up to half the sample rate. Powers add up over
stops without regard to phase; where a narrow line stands out of the spectrum around it in proportion to motor², the
phases are followed over the whole campaign, which fixes frequency, amplitude and phase. A tone above half the rate
shows at its alias. Where the phases do not hold from stop to stop, amplitudes come from the powers alone
(`tone_power.py`). What dies away after each arrival is taken off first: it keeps step with the moves, a tone does not.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults.gross_fault import FaultParameter, GrossFault
from station.diagnosis.data.faults.tone_power import power_per_visit
from station.domain.core.types import Array, Floats, SampleTable
from station.domain.recipe.recipe import Recipe

#: Nats of log-likelihood that a line must gain beyond the number of frequencies tried.
MIN_GAIN_NATS = 12.0
#: Frequencies tried for each 1/dwell.
OVERSAMPLING = 2
#: The spectrum around a line: so many frequencies on each side, less those that the line itself reaches.
BACKGROUND_BINS, LINE_BINS = 12, 2
#: A unit needs so many stops before its arrivals can be told from its tones.
MIN_FILTER_VISITS = 8
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
    def middle_s(self) -> Floats:
        """Where each stop's phase is taken (v)."""
        return np.asarray(self.time_s[:, 0])


def white_dwells(table: SampleTable, stop: NDArray[np.intp], rate_hz: float) -> tuple[WhiteDwells, float]:
    """The stops' samples without their slow course, and their noise."""
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
    sigma = float(np.median(np.abs(flat[at]))) / 0.6745
    motor = np.add.reduceat(table.values["motor"], first) / length
    return WhiteDwells(flat / max(sigma, 1e-300), reading, time, motor, rate_hz, clean), sigma


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
    seen = _power_spectrum(table, stop, rate, tried)
    gains = _gains(seen)
    best = int(gains.argmax())
    if gains[best] < MIN_GAIN_NATS + np.log(len(tried)):
        return []
    d, sigma = white_dwells(table, stop, rate)
    return [_fault(d, _refine_frequency(d, float(tried[best])), sigma, float(gains[best]), recipe)]


class PowerSpectrum(NamedTuple):
    """power (f, 3): mean of the stops, each weighted as a tone in proportion to motor would show in it; stops: how
    many count, by their weight."""

    power: Floats
    stops: float


def _power_spectrum(table: SampleTable, stop: NDArray[np.intp], rate_hz: float, tried: Floats) -> PowerSpectrum:
    """The spectrum of all stops at frequencies tried in equal steps, some units after others."""
    power, weight, squares = np.zeros((len(tried), 3)), 0.0, 0.0
    starts = np.flatnonzero(np.diff(table.unit.code, prepend=-1))
    part = np.append(starts[np.diff(starts // SAMPLES_AT_ONCE, prepend=-1) > 0], len(stop))
    for first, last in pairwise(part):
        d, _ = white_dwells(table[first:last], stop[first:last] - stop[first], rate_hz)
        power += _power(d, tried)
        weight += float(np.sum(_weight(d)))
        squares += float(np.sum(_weight(d) ** 2))
    return PowerSpectrum(power / max(weight, 1e-300), weight**2 / max(squares, 1e-300))


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


def _gains(seen: PowerSpectrum) -> Floats:
    """Log-likelihood (f) that a line of powers (f, 3) gains over the median of the spectrum around it.

    The background is the data's own, so neither the tails nor the colour of the noise can pass for a line. Powers
    are exponential: a mean of N of them that is r times what it should be is e^(−N(r − 1 − ln r)) likely (Chernoff's
    bound). N counts the stops by their weight, and less where the background itself is known from few frequencies.
    """
    power, place = seen.power, np.arange(len(seen.power))
    far = np.abs(place[:, None] - place)
    around = (far > LINE_BINS) & (far <= BACKGROUND_BINS)
    background = np.array([np.median(power[near], axis=0) if near.any() else np.full(3, np.inf) for near in around])
    known = seen.stops / (1 + np.pi / 2 * OVERSAMPLING / np.maximum(around.sum(1), 1))
    ratio = np.maximum(power / np.maximum(background, 1e-300), 1.0)
    return np.asarray(known * np.sum(ratio - 1 - np.log(ratio), axis=1))


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


def _fault(d: WhiteDwells, frequency_hz: float, sigma: float, nats: float, recipe: Recipe) -> GrossFault:
    """Amplitude of each axis, frequency and phase by least squares on all samples."""
    for _ in range(4):
        angle = 2 * np.pi * frequency_hz * d.time_s
        waves = np.stack([_filtered(d, np.sin(angle)), _filtered(d, np.cos(angle))])
        c = _amplitude(waves, d.white)
        late = 2 * np.pi * (d.time_s - d.time_s.mean())
        bend = _filtered(d, late * np.cos(angle)) * c[0] - _filtered(d, late * np.sin(angle)) * c[1]
        left = d.white - np.einsum("kvsi,ki->vsi", waves, c)
        frequency_hz += float(np.sum(bend * left) / max(float(np.sum(bend**2)), 1e-300))
    power = power_per_visit(waves, d.white)
    if power.exceeds(c):
        return _incoherent_fault(d, frequency_hz, sigma, nats, recipe)
    strong = int(np.argmax(np.hypot(*c)))
    phase = float(np.arctan2(c[1, strong], c[0, strong]) % (2 * np.pi))
    along = c[0] * np.cos(phase) + c[1] * np.sin(phase)
    std = sigma / np.sqrt(max(float(np.sum(waves[0] ** 2)) / 3, 1e-300))
    numbers = [
        FaultParameter("amplitude", axis, "common", float(a * sigma), float(std), recipe.unit)
        for axis, a in zip("xyz", along, strict=True)
    ]
    told_std = float(1 / np.sqrt(max(float(np.sum(bend**2)), 1e-300)))
    numbers.append(FaultParameter("frequency", None, "common", frequency_hz, told_std, "Hz"))
    numbers.append(FaultParameter("phase", None, "common", phase, float(std / (sigma * np.hypot(*c)[strong])), "rad"))
    told = f"a tone of {frequency_hz:.3f} Hz follows the motors"
    return GrossFault("motor-tone", "common", tuple(numbers), told, nats)


def _incoherent_fault(d: WhiteDwells, frequency_hz: float, sigma: float, nats: float, recipe: Recipe) -> GrossFault:
    """Amplitude of each axis and frequency where every stop has a phase of its own: the motors are not in step."""
    # What a unit's stops have in common mixes their phases: each stop stands for itself here.
    alone = replace(d.filter, units=())
    d = replace(d, white=alone(d.reading) / max(sigma, 1e-300), filter=alone)
    resolution = d.rate_hz / (OVERSAMPLING * d.white.shape[1])
    tried = frequency_hz + resolution * np.linspace(-1, 1, 41)
    frequency_hz = float(tried[np.argmax(_power(d, tried).sum(1))])
    angle = 2 * np.pi * frequency_hz * d.time_s
    found = power_per_visit(np.stack([_filtered(d, np.sin(angle)), _filtered(d, np.cos(angle))]), d.white)
    numbers = [
        FaultParameter("amplitude", axis, "common", float(a * sigma), float(std * sigma), recipe.unit)
        for axis, a, std in zip("xyz", found.amplitude, found.amplitude_std, strict=True)
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
    said = np.einsum("kvsi,vsi->ik", waves, white)
    return np.asarray(np.linalg.solve(normal, said[..., None])[..., 0].T)
