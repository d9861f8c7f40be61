"""The test that is told the form: which cause, its exact shape and how large its amplitudes are, not the coefficients.

Its columns come from the bench that hides the cause, one coefficient switched on at a time, at every sample and free of
each unit's offset and gain. Under white noise the strongest test is then the likelihood ratio with the coefficients
integrated out, at the true amplitude, against its own 99 % quantile where nothing is hidden. Where it is not known
which stop or which jump is hit, the ratio is averaged over the places.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from tests.blind.bench import WHITE, Hidden, World, world
from tests.blind.hidden import KNOWN, WRONG_FORM
from tests.blind.recipes import recipe

Array = Any
#: Causes that hit a place nobody knows, and how many places are drawn.
SCATTERED, PLACES = ("step", "disturbed-visit"), 150
LEVEL, POWER = 0.01, 0.8
#: Draws of noise, and strengths at which the power is computed.
DRAWS, STRENGTHS = 20_000, np.geomspace(2.0, 12.0, 25)


class OneHot(np.random.Generator):
    """Random numbers whose amplitudes are all 0 but one, which is `typical`; the others are drawn as usual."""

    chosen, count = -1, 0

    def amplitude(self, typical: float, shape: tuple[int, ...]) -> Array:
        """Zeros, or `typical` in the chosen place."""
        self.standard_normal(shape)
        out = np.zeros(int(np.prod(shape)))
        if 0 <= self.chosen - self.count < len(out):
            out[self.chosen - self.count] = typical
        self.count += len(out)
        return out.reshape(shape)


def columns(w: World, hidden: Hidden, start: Any) -> Array:
    """What each coefficient of usual size leaves (n·3, K), free of offset and gain, in units of a sample's noise.

    start: state of the PCG64 that the hidden thing draws from.
    """
    sigma = WHITE.density * np.sqrt(w.recipe.device.rate_hz / 2)
    still = np.asarray(w.a)
    found: list[Array] = []
    count, i = 1, 0
    while i < count:
        rng = OneHot(np.random.PCG64())
        rng.bit_generator.state, rng.chosen = start, i
        felt, added = hidden(w, rng)
        found.append((felt - still + added) / sigma)
        count, i = rng.count, i + 1
    return freed(w, np.stack(found, axis=-1)).reshape(-1, count)


def freed(w: World, columns: Array) -> Array:
    """Columns (n, 3, K) without what each unit's offset and gain take up."""
    a = w.a
    out = np.empty_like(columns)
    for u in np.unique(w.unit):
        rows = w.unit == u
        for i in range(3):
            basis, _ = np.linalg.qr(np.stack([np.ones(rows.sum()), a[rows, i]], 1))
            y = columns[rows, i]
            out[rows, i] = y - basis @ (basis.T @ y)
    return out


@dataclass(frozen=True, eq=False)
class Form:
    """normal (J·K, J·K): inner products of the columns of J places with K coefficients each."""

    normal: Array
    places: int

    @property
    def size(self) -> int:
        """Coefficients of a place."""
        return len(self.normal) // self.places

    def block(self, j: int) -> tuple[Array, Array]:
        """Eigenvalues (K) and vectors of one place."""
        at = slice(j * self.size, (j + 1) * self.size)
        m, E = np.linalg.eigh(self.normal[at, at])
        return np.maximum(m, 0.0), E

    def ratio(self, products: Array, d: float) -> Array:
        """The log-likelihood ratio (n) of products (n, J·K) of the data with the columns, told that E d² is d²."""
        each = []
        for j in range(self.places):
            m, E = self.block(j)
            q = d**2 / max(m.sum(), 1e-300) * m
            observed = m > 1e-9 * m.max()
            u = products[:, j * self.size : (j + 1) * self.size] @ E
            z2 = u[:, observed] ** 2 / m[observed]
            each.append(0.5 * (q / (1 + q))[observed] @ z2.T - 0.5 * np.log1p(q).sum())
        top = np.max(each, axis=0)
        return top + np.log(np.mean(np.exp(np.array(each) - top), axis=0))

    def needed(self, seed: int = 1) -> float:
        """The strength d at which the test fires in 80 of 100."""
        rng = np.random.default_rng(seed)
        values, vectors = np.linalg.eigh(self.normal)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        draws = DRAWS if self.places == 1 else DRAWS // 10
        noise = rng.standard_normal((draws, len(root))) @ root.T
        unit = self._signals(rng, draws)
        power = []
        for d in STRENGTHS:
            threshold = np.quantile(self.ratio(noise, d), 1 - LEVEL)
            other = rng.permutation(noise) + d * unit
            power.append(float(np.mean(self.ratio(other, d) > threshold)))
            if power[-1] > 0.97:
                break
        return float(np.exp(np.interp(POWER, power, np.log(STRENGTHS[: len(power)]))))

    def _signals(self, rng: np.random.Generator, draws: int) -> Array:
        """Products (n, J·K) of signals of length 1, of coefficients of one place drawn as usual, with the columns."""
        out = np.empty((draws, len(self.normal)))
        for n in range(draws):
            at = slice(*(self.size * (rng.integers(self.places) + np.arange(2))))
            c = rng.standard_normal(self.size)
            out[n] = self.normal[:, at] @ c / np.sqrt(c @ self.normal[at, at] @ c)
        return out

    def gain(self, d: float) -> float:
        """d² less what estimating the coefficients costs: twice the nats the true model gains on fresh data."""
        m, _ = self.block(0)
        q = d**2 / max(m.sum(), 1e-300) * m
        return float(d**2 - np.sum(q / (1 + q)))


@cache
def form(name: str, seed: int = 1, units: int = 4) -> Form:
    """The form of something the blind tests hide in the tilt recipe."""
    hidden = KNOWN[name] if name in KNOWN else WRONG_FORM[name][1]
    w = world(recipe(), units, np.random.default_rng(seed))
    places = PLACES if name in SCATTERED else 1
    Z = np.concatenate([columns(w, hidden, np.random.PCG64(seed + j).state) for j in range(places)], axis=1)
    return Form(Z.T @ Z, places)
