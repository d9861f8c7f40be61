"""Terms that the data cannot separate, and which of them to write down."""

from collections.abc import Sequence

import numpy as np

from station.diagnosis.discovery.price import price
from station.diagnosis.discovery.term_fit import TermFit, TermSpace, TermSpaces, fit_term, search_constant
from station.domain.core.types import Floats
from station.model.effect import stimulus_strength
from station.model.formula.expression import constants, evaluate, places_of, variables
from station.model.scene import Scene

#: Two curves of one input are one where they are no further apart than this, in white data.
SAME_CURVE = 0.5
#: Formulas so near to the best, nats, are given as one set.
SET_NATS = 3.0
#: Temperatures between those of the visits, and tilts between theirs, at which curves are compared.
TEMPERATURES, TILTS = 40, 41
#: Inputs whose part that no modulator changes the calibration takes up.
CALIBRATED = frozenset({"one", "own"})


def simplest(ranked: Sequence[TermFit], scene: Scene) -> TermFit:
    """The best term, or the simplest of those close to it that are the same curve of the same input in a shorter
    form."""
    best = ranked[0]
    same = [f for f in ranked if f.odds > best.odds - SET_NATS and is_same_curve(f, best, scene)]
    return min(same, key=lambda f: (price(f.term), -f.odds))


def is_same_curve(one: TermFit, two: TermFit, scene: Scene) -> bool:
    """Whether two terms of one input, or of one component that the axis feels, differ by less than noise shows, both at
    the visits and at temperatures and tilts between them. A decay without end is a constant; but a square and a corner
    are two laws even if only two temperatures were run, and so are a cube and a dead band at tilts of 45°."""
    if one.term.input != two.term.input and not (_of_own_tilt(one) and _of_own_tilt(two)):
        return False
    if not is_same_signal(one, two):
        return False
    return max(_apart_between(one, two, scene), _apart_between_tilts(one, two, scene)) < SAME_CURVE**2


def is_same_signal(one: TermFit, two: TermFit) -> bool:
    """Whether two terms differ by less than noise shows at the visits."""
    return one.signal.shape == two.signal.shape and _distance(one, two) < SAME_CURVE**2


def _apart_between(one: TermFit, two: TermFit, scene: Scene) -> float:
    """Sum of squares by which two functions of temperature differ if visits of such signals were spread evenly over the
    temperatures; none for functions of anything else."""
    if {name for f in (one, two) for name in variables(f.term.factors[1].tree)} != {"T"}:
        return 0.0
    T = scene.require("temperature_degC")
    at = np.linspace(float(T.min()), float(T.max()), TEMPERATURES)
    return _apart(one, _curve(one, at), _curve(two, at))


def _apart(fit: TermFit, x: Floats, y: Floats) -> float:
    """The sum of squares of a signal that another curve cannot follow."""
    along = float(x @ y) ** 2 / max(float(x @ x) * float(y @ y), 1e-300)
    return float(np.sum(fit.signal**2)) * (1 - along)


def _curve(fit: TermFit, T: Floats) -> Floats:
    """How a term is modulated at some temperatures, without what the calibration takes up."""
    curve = np.broadcast_to(evaluate(fit.term.factors[1].tree, {("T", ""): T}, dict(fit.term.constants)), T.shape)
    return np.asarray(curve - curve.mean() if fit.term.input in CALIBRATED else curve, float)


def _of_own_tilt(fit: TermFit) -> bool:
    """Whether what the axis feels is a function of its own component alone."""
    tree = fit.term.factors[0].tree
    return not fit.term.is_turn and variables(tree) == {"a"} and places_of(tree) == {"i"}


def _apart_between_tilts(one: TermFit, two: TermFit, scene: Scene) -> float:
    """The same of two functions of what the axis feels, at tilts spread evenly; none where they are one function."""
    if one.term.input == two.term.input:
        return 0.0
    reach = stimulus_strength(scene.recipe)
    at = np.linspace(-reach, reach, TILTS)
    x, y = (evaluate(f.term.factors[0].tree, {("a", "i"): at}, dict(f.term.constants)) for f in (one, two))
    if {one.term.modulator, two.term.modulator} == {"constant"}:
        taken = np.linalg.qr(np.stack([np.ones(TILTS), at], axis=1))[0]
        x, y = (c - taken @ (taken.T @ c) for c in (x, y))
    return _apart(one, x, y)


def unparted(ranked: Sequence[TermFit], best: TermFit, spaces: TermSpaces) -> list[TermFit]:
    """The terms that are as likely as the best, and those that only their price puts behind it: no noise at these
    visits could separate them."""
    found = []
    for f in ranked:
        at = spaces.of(f.term)
        if f.odds > best.odds - SET_NATS or is_same_signal(f, best) or _bends_alike(f, best, at):
            found.append(f)
    return found


def _bends_alike(fit: TermFit, best: TermFit, at: TermSpace) -> bool:
    """Whether another shape of what the axis feels can be bent to the signal of the best, although the two are
    different laws between the tilts of these visits: fitted to the noise, it lies slightly beside it."""
    shape, fields = fit.term, constants(fit.term.factors[0].tree)
    if not fields or shape.input == best.term.input or shape.modulator != best.term.modulator:
        return False
    if fit.evidence < best.evidence:
        return False
    shape = shape.with_constants(**{k: v for k, v in best.term.constants if k in shape.fields and k not in fields})
    size = float(np.sum(best.signal**2))
    for field in fields:
        shape = search_constant(shape, field, at.view, lambda t: size - _distance(fit_term(t, at), best)).term
    near = fit_term(shape, at)
    return is_same_signal(near, best) and not is_same_curve(near, best, at.view.scene)


def _distance(one: TermFit, two: TermFit) -> float:
    return float(np.sum((one.signal - two.signal) ** 2))


def other_families(near: Sequence[TermFit], best: TermFit, scene: Scene) -> tuple[TermFit, ...]:
    """The best of each family other than the leader's, the simplest first; no longer form of the leader's curve."""
    found: dict[tuple[str, str], TermFit] = {}
    for f in near:
        longer = price(f.term) > price(best.term) and is_same_curve(f, best, scene)
        if f.term.family != best.term.family and not longer:
            found.setdefault(f.term.family, f)
    return tuple(sorted(found.values(), key=lambda f: (f.term.size, -f.odds)))
