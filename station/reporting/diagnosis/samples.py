"""What a report draws of single samples: the spectrum within the dwells, and the readings of one dwell."""

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults.gross_fault import GrossFault
from station.domain.core.types import Floats, SampleTable
from station.reporting.diagnosis.data import DwellSamples, ToneSpectrum

#: Samples of one dwell that are drawn.
MAX_SAMPLES = 120


def tone_spectrum(table: SampleTable) -> ToneSpectrum | None:
    """Amplitude against frequency over all dwells of the usual length; None where they are too short to have one.

    A dwell's mean and slope are taken off. With the motors on a dwell is divided by its motor level, and counts by the
    level's square, so that the amplitude is the one at full drive; those with the motors off are brought to that scale.
    """
    starts, ends = _dwells(table)
    lengths = ends - starts
    n = int(np.median(lengths))
    chosen = starts[lengths >= n]
    if n < 8 or not len(chosen):
        return None
    values = table.reading[chosen[:, None] + np.arange(n)]
    t = np.linspace(-1, 1, n)
    values = values - values.mean(1, keepdims=True)
    slope = np.einsum("vsi,s->vi", values, t) / float(t @ t)
    values = values - slope[:, None] * t[:, None]
    window = np.hanning(n)
    power = np.abs(np.fft.rfft(values * window[:, None], axis=1) * 2 / window.sum()) ** 2
    step = float(np.median(np.diff(table.time_s[chosen[0] : chosen[0] + n])))
    motor = table.values["motor"][chosen] if "motor" in table.values else np.ones(len(chosen))
    on = np.asarray(motor > 0)
    if not on.any():
        return None
    drive2 = float(np.sum(motor[on] ** 2))
    driven = np.sqrt(power[on].sum(0) / drive2)
    i = int(np.argmax(driven[1:].max(axis=0)))
    # Noise does not grow with the drive: on the same scale it stands as high in both.
    rest = np.sqrt(power[~on].mean(0) * np.count_nonzero(on) / drive2)[:, i] if (~on).any() else None
    frequency = np.asarray(np.fft.rfftfreq(n, step), float)
    return ToneSpectrum("xyz"[i], frequency[1:], np.asarray(driven[1:, i]), None if rest is None else rest[1:])


def first_dwell(table: SampleTable, fault: GrossFault) -> DwellSamples:
    """The samples of the first dwell of the first unit that a fault names, on the axis that moves most."""
    units = {n.of.partition(":")[2] for n in fault.numbers if n.of.startswith("unit:")}
    starts, ends = _dwells(table)
    serials = [table.unit.names[c] for c in table.unit.code[starts]]
    first = next((k for k, serial in enumerate(serials) if serial in units), 0)
    rows = slice(int(starts[first]), int(min(ends[first], starts[first] + MAX_SAMPLES)))
    reading: Floats = np.asarray(table.reading[rows], float)
    i = int(np.argmax(np.ptp(reading, axis=0)))
    return DwellSamples(serials[first], "xyz"[i], reading[:, i])


def usual_dwell_s(table: SampleTable) -> float:
    """How long a dwell lasts as a rule, from its first sample to its last."""
    starts, ends = _dwells(table)
    return float(np.median(table.time_s[ends - 1] - table.time_s[starts]))


def _dwells(table: SampleTable) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First row of each dwell, and the row behind its last."""
    key = np.stack([table.unit.code, table.run, table.visit])
    starts = np.flatnonzero(np.any(np.diff(key, axis=1, prepend=key[:, :1] - 1) != 0, axis=0))
    return starts, np.append(starts[1:], len(table.time_s))
