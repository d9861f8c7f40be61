"""The least amplitude ratio of any test that looks for all causes at once: what a search must pay, however it is made.

Told of every cause its exact shape and size and the white floor, but not which cause it is nor the coefficients, the
test of a level whose power is the greatest on the average over the causes is the mean of their likelihood ratios
(Neyman and Pearson). Each cause hides at the same multiple of the amplitude at which the test told its form fires in 80
of 100; the multiple at which the mean fires in 80 of 100 is the bound. Only the 23 causes compete here, no kernel.

A test that must not alarm either where a healthy floor walks by up to 10 µg a stop cannot be stronger than the one
whose floor walks by a size drawn from any given shares: the mean of the ratios over that of the walks. The shares that
leave it the least power are the tightest of those bounds.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from diagnosis_rows import oracle
from diagnosis_rows.oracle import LEVEL, POWER, Array, Form

from tests.blind.bench import WHITE, World, world
from tests.blind.hidden import KNOWN
from tests.blind.recipes import recipe

#: Multiples tried; null draws; draws with each cause; places of a cause that hits one nobody knows.
RATIOS, NULLS, EACH, PLACES = (1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6), 20_000, 600, 30
#: Walks that a healthy floor may have, as parts of the largest, and that, in the recipe's unit a stop.
WALKS, LARGEST_WALK = (0.0, 0.25, 0.5, 1.0), 1e-5
#: Nothing walks; and shares of the walks that a healthy floor may have.
STILL, SHARES = (1.0, 0.0, 0.0, 0.0), ((0.25,) * 4, (0.5, 0.0, 0.5, 0.0), (0.1, 0.4, 0.4, 0.1), (0.0, 1.0, 0.0, 0.0))
#: Directions along which the largest walk adds less than this to the noise's variance show nothing of it.
LEAST_SHOWN = 0.02


@dataclass(frozen=True, eq=False)
class AllForms:
    """The form of each cause, and the inner products of the columns of all with those along which a floor walks, of
    which the largest walk makes `walk` (w) times the variance of the noise; needed (causes): the strength at which the
    test told the form fires in 80 of 100."""

    forms: list[Form]
    normal: Array
    walk: Array
    needed: Array

    @staticmethod
    def of(seed: int) -> "AllForms":
        """Those of the blind tests in the tilt recipe."""
        w = world(recipe(), 4, np.random.default_rng(seed))
        columns, forms = list[Array](), list[Form]()
        for name in sorted(KNOWN):
            places = PLACES if name in oracle.SCATTERED else 1
            Z = [oracle.columns(w, KNOWN[name], np.random.PCG64(seed + j).state) for j in range(places)]
            columns.append(np.concatenate(Z, axis=1).astype(np.float32))
            forms.append(Form((columns[-1].T @ columns[-1]).astype(float), places))
        walk, along = _walk_columns(w)
        every = np.concatenate([*columns, along], axis=1)
        needed = np.array([form.needed() for form in forms])
        return AllForms(forms, (every.T @ every).astype(float), walk, needed)


def _walk_columns(w: World) -> tuple[Array, Array]:
    """Variances (w) of the largest walk beside the noise's along orthonormal columns (n·3, w)."""
    sigma = WHITE.density * np.sqrt(w.recipe.device.rate_hz / 2)
    first = np.flatnonzero(np.diff(w.stop, prepend=-1))
    steps = np.zeros((len(w.t), 3, 3 * len(first)), np.float32)
    for s, at in enumerate(first):
        later = (w.unit == w.unit[at]) & (w.run == w.run[at]) & (w.visit >= w.visit[at])
        for i in range(3):
            steps[later, i, 3 * s + i] = LARGEST_WALK / sigma
    C = oracle.freed(w, steps).reshape(-1, 3 * len(first)).astype(np.float32)
    values, vectors = np.linalg.eigh((C.T @ C).astype(float))
    shown = values > LEAST_SHOWN
    return values[shown], C @ (vectors[:, shown] / np.sqrt(values[shown])).astype(np.float32)


def least_ratio(of: AllForms, shares: Sequence[float], seed: int = 1) -> tuple[float, dict[str, float]]:
    """The bound where the floor walks by each of the walks in such a share of the healthy campaigns; on the average,
    and that of each cause by the same test."""
    values, vectors = np.linalg.eigh(of.normal)
    shown = values > 1e-9 * values.max()
    root = (vectors[:, shown] * np.sqrt(values[shown])).T
    rng = np.random.default_rng(seed)
    power = np.array([_power(of, root, ratio * of.needed, np.asarray(shares), rng) for ratio in RATIOS])
    alone = {n: float(np.interp(POWER, power[:, i], RATIOS)) for i, n in enumerate(sorted(KNOWN))}
    return float(np.interp(POWER, power.mean(axis=1), RATIOS)), alone


def _power(of: AllForms, root: Array, d: Array, shares: Array, rng: np.random.Generator) -> Array:
    """Power (causes), each at its strength d, where nothing walks but in the sets without a cause."""
    noise = [_statistic(of, _without(of, root, shares, rng), d, shares) for _ in range(NULLS // 4000)]
    threshold = np.quantile(np.concatenate(noise), 1 - LEVEL)
    fired, first = [], 0
    for form, strength in zip(of.forms, d, strict=True):
        products = rng.standard_normal((EACH, len(root))) @ root
        for i in range(EACH):
            at = first + form.size * int(rng.integers(form.places)) + np.arange(form.size)
            c = rng.standard_normal(form.size)
            products[i] += strength * (of.normal[:, at] @ c) / np.sqrt(c @ of.normal[np.ix_(at, at)] @ c)
        fired.append(np.mean(_statistic(of, products, d, shares) > threshold))
        first += len(form.normal)
    return np.array(fired)


def _without(of: AllForms, root: Array, shares: Array, rng: np.random.Generator) -> Array:
    """Products of 4,000 sets in which nothing is hidden, with the columns."""
    size = rng.choice(WALKS, 4000, p=shares)[:, None] * np.sqrt(of.walk)
    along = of.normal[len(of.normal) - len(of.walk) :]
    return rng.standard_normal((4000, len(root))) @ root + (size * rng.standard_normal(size.shape)) @ along


def _statistic(of: AllForms, products: Array, d: Array, shares: Array) -> Array:
    """Log of the mean likelihood ratio (n) of the causes less that of the walks, of products (n, columns of all)."""
    ends = np.cumsum([0, *(len(form.normal) for form in of.forms)])
    each = [f.ratio(products[:, a:b], x) for f, a, b, x in zip(of.forms, ends[:-1], ends[1:], d, strict=True)]
    squares, walked = products[:, ends[-1] :] ** 2, []
    for part, share in zip(WALKS, shares, strict=True):
        if share > 0:
            q = part**2 * of.walk
            walked.append(np.log(share) + 0.5 * squares @ (q / (1 + q)) - 0.5 * np.log1p(q).sum())
    found = np.logaddexp.reduce(each, axis=0) - np.log(len(each))
    return np.asarray(found - np.logaddexp.reduce(walked, axis=0))
