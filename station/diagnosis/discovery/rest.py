"""Whether what a formula leaves is noise: its size, and whether any of it repeats.

A law outside the grammar is followed a little, and what is left hardly enlarges the residual as a whole. But it
repeats: at the same visit of the same run of all units, at one position, at one level of a covariate, on one axis, or
in proportion to what the axes feel. Each such pattern is fitted freely, one mean for each of its groups. The scatter
within the visits says how large noise makes it, so its sum of squares is a χ² (lack of fit on replicated points).

The curves of the formula's own terms are tested first and at a level of their own, because they are few: where a term
is the whole law, points scatter about its curve as noise alone makes them.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from station.diagnosis.candidates.bank import PER_UNIT_LEVELS
from station.diagnosis.discovery.order_selection import along_directions, order_chance
from station.diagnosis.discovery.pooled_curves import constant_columns, pooled_curves
from station.diagnosis.discovery.scan import ScannedUnits, scanned_units
from station.diagnosis.linear.eigen import eigenvectors
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.linear.projection import ResidualSpace
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Floats
from station.model.formula.term import Term

#: By how many standard deviations the whole may be larger than noise makes it, and the chances that any of the patterns
#: fails, or any curve of a term, or any that all share, where nothing is left: most where least numbers are free.
MOST_EXCESS, PATTERN_CHANCE, CURVE_CHANCE, POOLED_CHANCE = 1.8, 0.02, 0.02, 0.1
#: What was recorded beside the readings is cut into so many groups of as many visits each, and so many along the curve
#: of a term; units looked at, at most.
GROUPS, CURVE_GROUPS, MOST_UNITS = 12, (6, 20), 40
#: Groups that are left free together, at most: of more of them hardly any repeats, and the whole axis tells as much.
MOST_FREE_GROUPS = 256
COVARIATES = ("time_s", "temperature_degC", "temperature_rate", "motor")
#: A direction that keeps less than this share of its squared length is lost in what is known. Coefficients that were
#: fitted leave a few hundredths: along them nothing can be off, and to count them would hide what is.
VISIBLE_SHARE = 0.1


class Pattern(NamedTuple):
    """Columns (v, c) on one axis; own: whether each unit has sizes of its own, of each way that is looked at."""

    columns: Floats
    axis: int
    own: tuple[bool, ...]


def is_noise(problem: ScoringProblem, terms: Sequence[Term]) -> bool:
    """Whether what a formula leaves is no larger than the visits' own noise and repeats nowhere."""
    floor = visit_noise(problem)
    if floor.noise <= 0:
        return True
    if excess_of_rest(problem.space(floor, moving=False)) > MOST_EXCESS:
        return False
    units = scanned_units(problem, MOST_UNITS)
    space = units.setting.space(floor, moving=False)
    about_curves = pattern_chances(_curves_of_terms(problem, units.visits, terms), units, space)
    curves = (*about_curves, *prior_chances(units, space))
    rest = (*axis_chances(units, space), *pattern_chances(_repeating_patterns(problem, units.visits), units, space))
    pooled = list(_pooled_chances(problem, units, space, terms))
    chances = (curves, CURVE_CHANCE), (rest, PATTERN_CHANCE), (pooled, POOLED_CHANCE)
    return all(_all_by_chance(found, chance) for found, chance in chances)


def visit_noise(problem: ScoringProblem) -> NoiseFloor:
    """The floor that the scatter of the samples within the visits implies, without any scatter of the visits
    themselves. Single readings show none: they have the noise of the floor that fits."""
    reduced = problem.view.reduced
    if not reduced.sigma > 0:
        return NoiseFloor(problem.fit().floor.noise, 0.0, 0.0)
    return NoiseFloor(float(reduced.sigma / np.sqrt(reduced.count.sum(1).mean())), 0.0, 0.0)


def _all_by_chance(found: Sequence[float], chance: float) -> bool:
    return min(found, default=1.0) > chance / max(len(found), 1)


def excess_of_rest(space: ResidualSpace) -> float:
    """By how many standard deviations the rest is larger than noise makes it."""
    return (space.rest / space.dof - 1) / float(np.sqrt(2 / space.dof))


def axis_chances(units: ScannedUnits, space: ResidualSpace) -> Iterator[float]:
    """The chance that the rest on each axis is as large as it is."""
    grid = units.setting.layout.grid
    _, R, V = grid.slot.shape
    lost = np.sum(space.basis**2, axis=2) + np.sum(space.shared_basis**2, axis=2)
    free, square = np.where(space.live, 1 - lost, 0.0), space.residual**2
    for axis in range(grid.k):
        rows = slice(axis, R * V * grid.k, grid.k)
        dof = float(np.sum(free[:, rows]))
        if dof >= 1:
            yield float(scipy.special.chdtrc(dof, np.sum(square[:, rows])))


def prior_chances(units: ScannedUnits, space: ResidualSpace) -> Iterator[float]:
    """The chance that what is known only by a prior, such as the error of a covariate, is as far off as it is: a term
    must not fit a law by bending its covariate."""
    grid = units.setting.layout.grid
    _, R, V = grid.slot.shape
    # What changes within the dwells stands between the visits' means and what is known beforehand.
    first = R * V * grid.k + space.dwell
    rows = first + np.flatnonzero(space.live[:, first:].any(axis=0))
    if len(rows):
        priors = np.zeros((*space.live.shape, len(rows)))
        priors[:, rows, np.arange(len(rows))] = space.live[:, rows]
        yield from _chance(space.free(priors), space)


def pattern_chances(patterns: Iterable[Pattern], units: ScannedUnits, space: ResidualSpace) -> Iterator[float]:
    """The chance that each pattern holds as much of the rest as it does."""
    layout = units.setting.layout
    for p in (p for p in patterns if p.columns.shape[1]):
        white = space.project(layout.columns(layout.keep[:, :, p.axis, None] * p.columns[:, None], None))
        for own in p.own:
            yield from _chance(white if own else white.reshape(1, space.data.size, -1), space)


def _pooled_chances(
    problem: ScoringProblem, units: ScannedUnits, space: ResidualSpace, terms: Sequence[Term]
) -> Iterator[float]:
    """The chance that one curve for all units and axes, times the sizes of a term, holds as much as it does. The terms
    are what was accepted last."""
    layout = units.setting.layout
    for item, term in zip(problem.accepted[len(problem.accepted) - len(terms) :], terms, strict=True):
        fitted = constant_columns(problem, item, term)
        for curve in pooled_curves(problem, item, term, COVARIATES):
            columns = np.concatenate([fitted, curve], axis=2)[units.visits]
            white = space.project(layout.columns(layout.keep @ columns, None)).reshape(space.data.size, -1)
            along = along_directions(white, fitted.shape[2], space)
            if len(along):
                yield order_chance(along)


def _chance(columns: Floats, space: ResidualSpace) -> Iterator[float]:
    """The chance of what the rest has along columns (U or 1, ·, c) of each unit or of all, if they show anything."""
    residual = space.residual
    normal = columns.swapaxes(1, 2) @ columns
    if len(columns) == 1:
        known = space.shared_basis.reshape(residual.size, -1).T @ columns[0]
        normal = normal - known.T @ known
    m, E = eigenvectors(normal)
    visible = m > VISIBLE_SHARE * np.maximum(m.max(initial=0.0), 1e-300)
    along = (E.swapaxes(1, 2) @ (columns.swapaxes(1, 2) @ residual.reshape(len(columns), -1, 1)))[..., 0]
    if np.any(visible):
        yield float(scipy.special.chdtrc(np.count_nonzero(visible), np.sum(along[visible] ** 2 / m[visible])))


def _repeating_patterns(problem: ScoringProblem, visits: NDArray[np.bool_]) -> Iterator[Pattern]:
    """What may repeat in the rest, at some visits (v)."""
    scene = problem.view.scene
    felt = problem.view.signal.true[visits]
    ones = np.ones((len(felt), 1))
    run, position = (scene.codes(level)[visits] for level in ("run-of-recipe", "position"))
    visit = np.asarray(scene.visits.visit)[visits]
    occasion = np.unique(np.stack([run, visit]), axis=1, return_inverse=True)[1].ravel()
    levels = [_level_groups(scene.require(name)[visits], GROUPS) for name in COVARIATES if scene.is_recorded(name)]
    for axis in range(3):
        yield Pattern(_group_columns(occasion, ones), axis, (False,))
        yield Pattern(_group_columns(position, ones), axis, (False,))
        for group in levels:
            for times in (ones, *felt.T[..., None]):
                yield Pattern(_group_columns(group, times), axis, (False, True))


def _curves_of_terms(problem: ScoringProblem, visits: NDArray[np.bool_], terms: Sequence[Term]) -> Iterator[Pattern]:
    """Any curve in place of that of each term: along what modulates it, and from position to position."""
    scene = problem.view.scene
    signal = problem.view.signal
    run, position = (scene.codes(level)[visits] for level in ("run-of-recipe", "position"))
    for term in terms:
        if term.is_turn or "since_arrival_s" in term.needs:
            continue
        own = (term.of in PER_UNIT_LEVELS,)
        parts = {c: term.factor_values(c, signal) for c in term.columns}
        felt = {(c.i, c.j, c.phase): one[visits, None] for c, (one, _) in parts.items()}
        modulated = {(c.i, c.j, c.wave): two[visits, None] for c, (_, two) in parts.items()}
        along = scene.require(next(iter(term.needs), "time_s"))[visits]
        for groups in CURVE_GROUPS if term.modulator != "constant" else ():
            yield from (Pattern(_group_columns(_level_groups(along, groups), x), at[0], own) for at, x in felt.items())
        yield from (Pattern(_group_columns(run, x), at[0], (True,)) for at, x in felt.items())
        for (i, j, _), x in modulated.items():
            yield Pattern(_group_columns(position, x), i, own)
            for axis in (i, j) if term.input != "one" else ():
                yield Pattern(_group_columns(_level_groups(signal.true[visits, axis], GROUPS), x), i, own)


def _level_groups(values: Floats, groups: int) -> NDArray[np.intp]:
    """Groups (v) of about as many visits each, by the size of something recorded."""
    edges = np.unique(np.quantile(values, np.linspace(0, 1, groups + 1)[1:-1]))
    return np.searchsorted(edges, values, side="right")


def _group_columns(code: NDArray[np.int32] | NDArray[np.intp], times: Floats) -> Floats:
    """A column for each group: some values (v, 1) where a visit is of the group, 0 elsewhere; none of too many."""
    groups = np.unique(code)
    if len(groups) > MOST_FREE_GROUPS:
        groups = groups[:0]
    return np.asarray((code[:, None] == groups) * times)
