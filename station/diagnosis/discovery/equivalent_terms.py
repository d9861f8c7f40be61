"""Terms that data cannot tell apart, and which of them to write down."""

from collections.abc import Sequence

import numpy as np

from station.diagnosis.discovery.price import price
from station.diagnosis.discovery.term_fit import TermFit

#: Two curves of one input are one where they are no further apart than this, in white data.
SAME_CURVE = 0.5
#: Formulas so near to the best, nats, are given as one set.
SET_NATS = 3.0


def simplest(ranked: Sequence[TermFit]) -> TermFit:
    """The best, or the simplest of those near it that are the same curve of the same input spelt with less."""
    best = ranked[0]
    same = [f for f in ranked if f.odds > best.odds - SET_NATS and _is_same_curve(f, best)]
    return min(same, key=lambda f: (price(f.term), -f.odds))


def _is_same_curve(one: TermFit, two: TermFit) -> bool:
    """Whether two terms of one input differ by less than noise shows: a decay that lasts for ever is a constant."""
    if one.term.input != two.term.input or one.signal.shape != two.signal.shape:
        return False
    return bool(np.sum((one.signal - two.signal) ** 2) < SAME_CURVE**2)


def other_families(near: Sequence[TermFit], best: TermFit) -> tuple[TermFit, ...]:
    """The best of each family but the leader's own, the simplest first; no longer spelling of the leader's curve."""
    found: dict[tuple[str, str], TermFit] = {}
    for f in near:
        longer = _is_same_curve(f, best) and price(f.term) > price(best.term)
        if f.term.family != best.term.family and not longer:
            found.setdefault(f.term.family, f)
    return tuple(sorted(found.values(), key=lambda f: (f.term.size, -f.odds)))
