"""Readings with a stuck bit, put back where they would be without it."""

import numpy as np

from station.diagnosis.data.faults.bit_shifts import Dwells, restored

BIT, NOISE, SAMPLES = 5, 5.2, 36
FACES = np.concatenate([np.eye(3), -np.eye(3)])


def left_after(seed: int) -> float:
    """What the means of six faces are off by beyond any offset and gain, in their noise, at the worst axis: of a unit
    whose bit of six noises always reads 0, at an offset and gains of its own."""
    rng = np.random.default_rng(seed)
    where = np.repeat(np.arange(6), SAMPLES)
    true = 2048 * FACES[where] * (1 + 0.01 * rng.standard_normal(3)) + 40 * rng.standard_normal(3)
    code = np.round(true + NOISE * rng.standard_normal(true.shape)).astype(np.int64)
    fixed = restored(Dwells((code & ~(1 << BIT)).astype(float), where, 2048 * FACES, 2048.0), [(BIT, False)], 1.0)
    off = np.array([np.bincount(where, x) / SAMPLES for x in (fixed - code).T])
    rest = 0.0
    for axis, mean in enumerate(off):
        line = np.stack([np.ones(6), FACES[:, axis]], axis=1)
        rest = max(rest, float(np.abs(mean - line @ np.linalg.lstsq(line, mean, rcond=None)[0]).max()))
    return float(rest / (NOISE / np.sqrt(SAMPLES)))


def test_dwells_that_an_edge_of_the_bit_parts_say_where_they_lie() -> None:
    """Of two faces either may be shifted where the gain is free; the samples on the other side of the edge tell."""
    assert max(left_after(seed) for seed in range(30)) < 4.0
