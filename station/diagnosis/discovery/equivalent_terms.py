"""Terms that data cannot tell apart, and which of them to write down."""

from collections.abc import Sequence

import numpy as np

from station.diagnosis.discovery.price import price
from station.diagnosis.discovery.term_fit import TermFit
from station.domain.core.types import Floats
from station.model.formula.expression import evaluate, variables
from station.model.scene import Scene

#: Two curves of one input are one where they are no further apart than this, in white data.
SAME_CURVE = 0.5
#: Formulas so near to the best, nats, are given as one set.
SET_NATS = 3.0
#: Temperatures between those of the visits at which curves are compared.
TEMPERATURES = 40
#: Inputs whose part that no modulator changes the calibration takes up.
CALIBRATED = frozenset({"one", "own"})


def simplest(ranked: Sequence[TermFit], scene: Scene) -> TermFit:
    """The best, or the simplest of those near it that are the same curve of the same input spelt with less."""
    best = ranked[0]
    same = [f for f in ranked if f.odds > best.odds - SET_NATS and is_same_curve(f, best, scene)]
    return min(same, key=lambda f: (price(f.term), -f.odds))


def is_same_curve(one: TermFit, two: TermFit, scene: Scene) -> bool:
    """Whether two terms of one input differ by less than noise shows, at the visits and at the temperatures between: a
    decay that lasts for ever is a constant, but a square and a corner are two laws though only two temperatures were
    run."""
    if one.term.input != two.term.input or one.signal.shape != two.signal.shape:
        return False
    apart = float(np.sum((one.signal - two.signal) ** 2))
    return max(apart, _apart_between(one, two, scene)) < SAME_CURVE**2


def _apart_between(one: TermFit, two: TermFit, scene: Scene) -> float:
    """Sum of squares by which two functions of temperature differ, if visits of such signals were spread evenly over
    the temperatures; none where they are functions of anything else."""
    if {name for f in (one, two) for name in variables(f.term.factors[1].tree)} != {"T"}:
        return 0.0
    T = scene.require("temperature_degC")
    at = np.linspace(float(T.min()), float(T.max()), TEMPERATURES)
    x, y = (_curve(f, at) for f in (one, two))
    along = float(x @ y) ** 2 / max(float(x @ x) * float(y @ y), 1e-300)
    return float(np.sum(one.signal**2)) * (1 - along)


def _curve(fit: TermFit, T: Floats) -> Floats:
    """How a term is modulated at some temperatures, without what the calibration takes up."""
    curve = np.broadcast_to(evaluate(fit.term.factors[1].tree, {("T", ""): T}, dict(fit.term.constants)), T.shape)
    return np.asarray(curve - curve.mean() if fit.term.input in CALIBRATED else curve, float)


def other_families(near: Sequence[TermFit], best: TermFit, scene: Scene) -> tuple[TermFit, ...]:
    """The best of each family but the leader's own, the simplest first; no longer spelling of the leader's curve."""
    found: dict[tuple[str, str], TermFit] = {}
    for f in near:
        longer = price(f.term) > price(best.term) and is_same_curve(f, best, scene)
        if f.term.family != best.term.family and not longer:
            found.setdefault(f.term.family, f)
    return tuple(sorted(found.values(), key=lambda f: (f.term.size, -f.odds)))
