"""Axes that a sensor does not have, as the third of an inclinometer."""

import numpy as np

from station.domain.core.types import Floats


def noise_of_all(sigma: Floats) -> float:
    """Noise of a sample of all axes that scatter, from that of each (3); 0 where none does."""
    live = sigma[sigma > 0]
    return float(np.sqrt(np.mean(live**2))) if len(live) else 0.0


def with_noise_on_missing(block: Floats, count: Floats, sigma: Floats) -> Floats:
    """Means of blocks (v, B, 3) of so many samples (v, B), those of an axis that the sensor does not have with the
    noise of the others: three axes are searched, and one that is always the same would say that there is none."""
    missing = (sigma <= 0) & (np.ptp(block, axis=(0, 1)) == 0)
    if not missing.any() or not np.any(sigma > 0):
        return block
    noise = noise_of_all(sigma) / np.sqrt(np.maximum(count, 1))
    drawn = np.random.default_rng(len(block)).standard_normal(block.shape)
    return np.asarray(np.where(missing, block + noise[..., None] * drawn, block))
