"""What the true form gains on the very samples that are diagnosed: told its exact shape, the size of its amplitudes and
the white floor, it estimates the coefficients alone, each by its mean given the readings."""

from typing import Any

import numpy as np
from diagnosis_rows.oracle import columns, freed
from diagnosis_rows.trials import Request

from tests.blind.bench import WHITE, Floor, hide, world
from tests.blind.recipes import recipe

Array = Any


def gain_of_the_true_form(request: Request, size: float) -> float:
    """How much nearer to the noise-free samples it comes: twice the nats that it gains in expectation on the same
    campaign measured afresh. size: what was hidden, as a multiple of its usual size."""
    assert request.hidden is not None
    of = recipe(request.runs)
    rng = np.random.default_rng([request.seed, 77])
    w = world(of, request.units, rng)
    Z = columns(w, request.hidden, rng.bit_generator.state)
    sigma = WHITE.density * np.sqrt(of.device.rate_hz / 2)
    noisy, quiet = (
        hide(of, request.hidden, request.seed, units=request.units, floor=f, size=size)[0] for f in (WHITE, QUIET)
    )
    noise = freed(w, ((noisy.reading - quiet.reading) / sigma)[..., None]).ravel()
    signal = freed(w, (quiet.reading / sigma)[..., None]).ravel()
    m, E = np.linalg.eigh(Z.T @ Z)
    observed = m > 1e-9 * m.max()
    axes = Z @ E[:, observed] / np.sqrt(m[observed])
    q = signal @ signal / m[observed].sum() * m[observed]
    along, by_chance = axes.T @ signal, axes.T @ noise
    left = np.sum((q / (1 + q) * (along + by_chance) - along) ** 2) + signal @ signal - along @ along
    return float(signal @ signal - left)


#: The floor without noise, of the same random numbers.
QUIET = Floor(density=1e-12)
