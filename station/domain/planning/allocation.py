"""How to share time among visits: the least total dwell that brings every coefficient's variance to what is wanted.

A coefficient's variance is Σ_v price_v / T_v (Neyman 1934, J. R. Stat. Soc. 97, for one sum); several at once are the
multiplier form of minimax optimal design (Elfving 1952; Pukelsheim 2006, ch. 6). Convex, so the multipliers give a
lower bound with every step, and the search ends when time and bound agree.
"""

import numpy as np

from station.domain.core.types import Floats

#: Time and its lower bound agree to this share.
AGREE = 1e-3
#: Steps at most; a price list of 24 visits and 12 coefficients takes about thirty.
STEPS = 400
#: A coefficient out of reach is left this much more variance than the longest dwells would leave: the last percents
#: would cost the longest dwell at visits that hardly matter.
NEAR = 1.1
#: A visit that even its shortest dwell makes matter less than this does not matter.
ROUNDING = 1e-9
#: Power of the multipliers' step: 2 is exact for one coefficient, and swings between several.
POWER = 1.7


def least_dwells(price: Floats, past: Floats, shortest: Floats, longest: Floats) -> Floats:
    """Dwells T (f, v), s, of least sum with past + Σ_v price/T ≤ 1 for every coefficient, shortest ≤ T ≤ longest.

    price (f, c, v), s: a coefficient's variance from one second at a visit, over the variance wanted; past (f, c): what
    visits already done leave of it; shortest, longest (f, v), s. Where `longest` does not suffice for a coefficient, it
    comes as near as NEAR to what that would give.
    """
    price = np.maximum(price, 0.0)
    best_of_all = past + (price / longest[:, None]).sum(axis=2)
    # What is left of rounding is no way to make up for visits that were too short.
    price = np.where((price / shortest[:, None] > ROUNDING * best_of_all[..., None]), price, 0.0)
    room = np.where(price.any(axis=2), np.maximum(1.0, best_of_all * NEAR) - past, 1.0)
    multiplier = (np.sqrt(price).sum(axis=2) / room) ** 2 / price.shape[1]
    best = longest
    for _ in range(STEPS):
        weight = np.einsum("fc,fcv->fv", multiplier, price)
        T = np.clip(np.sqrt(weight), shortest, longest)
        ratio = _variance_ratio(price, T, room)
        feasible = np.clip(T * np.maximum(ratio.max(axis=1, keepdims=True), 1.0), shortest, longest)
        holds = _variance_ratio(price, feasible, room).max(axis=1) <= 1 + AGREE
        better = holds & (feasible.sum(axis=1) < best.sum(axis=1))
        best = np.where(better[:, None], feasible, best)
        bound = (T + weight / T).sum(axis=1) - (multiplier * room).sum(axis=1)
        if (best.sum(axis=1) - bound <= AGREE * best.sum(axis=1)).all():
            break
        multiplier = multiplier * np.maximum(ratio, 1e-9) ** POWER
    return best


def _variance_ratio(price: Floats, T: Floats, room: Floats) -> Floats:
    """Variance (f, c) that dwells T leave, over the room for it."""
    return np.asarray(np.einsum("fcv,fv->fc", price, 1 / T) / room)
