"""Dwells whose axes share noise, as a supply's is in all three: they are one witness of a tone, not three."""

from dataclasses import replace

import numpy as np

from station.diagnosis.data.faults.white_dwells import WhiteDwells
from station.domain.core.types import Array, Floats

#: Axes share noise from this correlation and so many standard errors on; the least share of it that is an axis' own.
LEAST_SHARED, SHARED_BY, LEAST_OWN = 0.1, 5.0, 0.01


def independent(d: WhiteDwells, frequency_hz: float) -> WhiteDwells:
    """The dwells along three directions that share no noise beside a tone of a frequency; as they are where hardly any
    is shared."""
    noise = _without(d, frequency_hz)[d.live]
    size = np.sqrt(np.maximum(np.mean(noise**2, axis=0), 1e-300))
    shared = noise.T @ noise / (max(len(noise), 1) * np.outer(size, size))
    apart = shared[np.triu_indices(3, 1)]
    if np.abs(apart).max() < max(LEAST_SHARED, SHARED_BY / np.sqrt(max(len(noise), 1))):
        return d
    square, directions = np.linalg.eigh(shared)
    return replace(d, white=d.white / size @ (directions / np.sqrt(np.maximum(square, LEAST_OWN))))


def _without(d: WhiteDwells, frequency_hz: float) -> Floats:
    """White samples (v, s, 3) without each dwell's own wave of a frequency."""
    turn: Array = np.exp(2j * np.pi * frequency_hz * d.time_s) * d.live
    amplitude = np.einsum("vs,vsi->vi", turn.conj(), d.white) / np.maximum(d.count, 1)[:, None]
    return np.asarray(d.white - 2 * np.real(turn[..., None] * amplitude[:, None]))
