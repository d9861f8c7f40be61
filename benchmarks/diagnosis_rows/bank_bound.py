"""The least amplitude ratio of any test that looks for all causes at once: what a search must pay, however it is made.

Told of every cause its exact shape and size and the white floor, but not which cause it is nor the coefficients, the
test of a level whose power is the greatest on the average over the causes is the mean of their likelihood ratios
(Neyman and Pearson). Each cause hides at the same multiple of the amplitude at which the test told its form fires in 80
of 100; the multiple at which the mean fires in 80 of 100 is the bound. Only the 23 causes compete here, no kernel.
"""

import numpy as np
from diagnosis_rows import oracle
from diagnosis_rows.oracle import LEVEL, POWER, Array, Form

from tests.blind.bench import world
from tests.blind.hidden import KNOWN
from tests.blind.recipes import recipe

#: Multiples tried; null draws; draws with each cause; places of a cause that hits one nobody knows.
RATIOS, NULLS, EACH, PLACES = (1.0, 1.1, 1.2, 1.3), 20_000, 600, 30


def least_ratio(seed: int = 1) -> float:
    """The bound for the causes of the blind tests in the tilt recipe."""
    forms, normal = _all_forms(seed)
    needed = np.array([form.needed() for form in forms])
    values, vectors = np.linalg.eigh(normal)
    shown = values > 1e-9 * values.max()
    root = (vectors[:, shown] * np.sqrt(values[shown])).T
    rng = np.random.default_rng(seed)
    power = [_power(forms, normal, root, ratio * needed, rng) for ratio in RATIOS]
    return float(np.interp(POWER, power, RATIOS))


def _all_forms(seed: int) -> tuple[list[Form], Array]:
    """The form of each cause, and the inner products of the columns of all."""
    w = world(recipe(), 4, np.random.default_rng(seed))
    columns, forms = list[Array](), list[Form]()
    for name in sorted(KNOWN):
        places = PLACES if name in oracle.SCATTERED else 1
        Z = [oracle.columns(w, KNOWN[name], np.random.PCG64(seed + j).state) for j in range(places)]
        columns.append(np.concatenate(Z, axis=1).astype(np.float32))
        forms.append(Form((columns[-1].T @ columns[-1]).astype(float), places))
    every = np.concatenate(columns, axis=1)
    return forms, (every.T @ every).astype(float)


def _power(forms: list[Form], normal: Array, root: Array, d: Array, rng: np.random.Generator) -> float:
    """Mean power over the causes, each at its strength d."""
    noise = [_mean_ratio(forms, rng.standard_normal((4000, len(root))) @ root, d) for _ in range(NULLS // 4000)]
    threshold = np.quantile(np.concatenate(noise), 1 - LEVEL)
    fired, first = [], 0
    for form, strength in zip(forms, d, strict=True):
        products = rng.standard_normal((EACH, len(root))) @ root
        for i in range(EACH):
            at = first + form.size * int(rng.integers(form.places)) + np.arange(form.size)
            c = rng.standard_normal(form.size)
            products[i] += strength * (normal[:, at] @ c) / np.sqrt(c @ normal[np.ix_(at, at)] @ c)
        fired.append(np.mean(_mean_ratio(forms, products, d) > threshold))
        first += len(form.normal)
    return float(np.mean(fired))


def _mean_ratio(forms: list[Form], products: Array, d: Array) -> Array:
    """Log of the mean likelihood ratio (n) of products (n, columns of all)."""
    ends = np.cumsum([0, *(len(form.normal) for form in forms)])
    each = [f.ratio(products[:, a:b], x) for f, a, b, x in zip(forms, ends[:-1], ends[1:], d, strict=True)]
    top = np.max(each, axis=0)
    return np.asarray(top + np.log(np.mean(np.exp(np.array(each) - top), axis=0)))
