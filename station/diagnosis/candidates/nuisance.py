"""What is already accounted for: the units' calibration, and the causes accepted so far.

An accepted cause keeps its columns in the model, with the prior that its evidence found for its coefficients: normal,
mean 0, variance `spread`². The next cause then sees the innovations: the strong directions of the accepted cause are
removed, the weak ones shrunk. Coefficients of a cause in a model file have a mean and deviation each.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.candidates.bank import PER_UNIT_LEVELS, Candidate, candidate_in_view
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.candidates.going_round import going_round_columns
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.grid import RowLayout
from station.diagnosis.linear.projection import DataColumns, NuisanceColumns
from station.domain.core.types import Floats
from station.domain.recipe import sensor
from station.model.forward import ActiveEffect, ActiveEffects


@dataclass(frozen=True, slots=True, eq=False)
class AcceptedCause:
    """A cause, or an unknown kernel, in the model.

    candidate: its columns at the present view; hit (groups) the groups that act; coefficient (groups, axes) now;
    mean, std (groups, axes) of its prior.
    """

    candidate: Candidate
    hit: NDArray[np.bool_]
    coefficient: Floats
    mean: Floats
    std: Floats

    def active_effects(self) -> dict[str, ActiveEffect]:
        """The cause at work, once for each of its shapes, by names in the simulation: one effect may act at two levels
        or with two shapes. Nothing of a kernel."""
        c = self.candidate
        return {
            f"{c.name}/{c.of}/{effect}": ActiveEffect(effect, np.where(groups[:, None], self.coefficient, 0.0), c.of)
            for effect, groups in c.shapes.items()
        }

    def added_to(self, active: ActiveEffects) -> dict[str, ActiveEffect]:
        """Causes at work, and this one: of one that was found before, in other groups, both."""
        found = dict(active)
        for key, acting in self.active_effects().items():
            more = found[key].coefficients if key in found else 0.0
            found[key] = acting._replace(coefficients=acting.coefficients + more)
        return found

    def taken_from(self, active: ActiveEffects) -> dict[str, ActiveEffect]:
        """Causes at work without this one; of one that was found elsewhere, too, that stays."""
        found = dict(active)
        for key in self.active_effects().keys() & found.keys():
            left = np.where(self.hit[:, None], 0.0, found[key].coefficients)
            if left.any():
                found[key] = found[key]._replace(coefficients=left)
            else:
                del found[key]
        return found

    def without(self, groups: Sequence[int]) -> "AcceptedCause":
        """The same where some groups do not act."""
        left = self.hit.copy()
        left[list(groups)] = False
        return replace(self, hit=left, coefficient=np.where(left[:, None], self.coefficient, 0.0))

    def in_view(self, view: ResidualView) -> "AcceptedCause":
        """The same with columns from the view, whose simulation it acts in."""
        return replace(self, candidate=candidate_in_view(self.candidate, view))


def active_together(accepted: Sequence[AcceptedCause]) -> dict[str, ActiveEffect]:
    """All accepted causes at work."""
    active: dict[str, ActiveEffect] = {}
    for item in accepted:
        active = item.added_to(active)
    return active


def accept_candidate(candidate: Candidate, hit: NDArray[np.bool_], spread: float) -> AcceptedCause:
    """A cause whose coefficients are not yet known."""
    shape = (len(candidate.names), candidate.axes)
    usual = np.array(candidate.axis_scale) if candidate.axis_scale else np.ones(candidate.axes)
    return AcceptedCause(candidate, hit, np.zeros(shape), np.zeros(shape), spread * np.broadcast_to(usual, shape))


@dataclass(frozen=True, slots=True, eq=False)
class CoefficientIndex:
    """Where the coefficients of an accepted cause stand: column numbers among the own or the shared ones.

    own: whether they are columns of units; unit, column (groups, axes); −1 for a group that does not act.
    """

    own: bool
    unit: NDArray[np.intp]
    column: NDArray[np.intp]


def nuisance_of(
    view: ResidualView, accepted: tuple[AcceptedCause, ...], matrix: bool
) -> tuple[NuisanceColumns, tuple[CoefficientIndex, ...]]:
    """Calibration and accepted causes as known columns, and where each cause's coefficients stand."""
    calibration = view.rows(view.calibration(matrix), None)
    units, p = view.grid.units, calibration.visit.shape[-1]
    own, shared = [calibration], [DataColumns(calibration.visit[..., :0])]
    precision, target = np.zeros((units, p)), np.zeros((units, p))
    common_precision, common_target = np.zeros(0), np.zeros(0)
    places: list[CoefficientIndex] = []
    for item in accepted:
        rows, place = accepted_columns(item, view.layout)
        weight, about = 1 / item.std**2, item.mean - item.coefficient
        if place.own:
            width = rows.visit.shape[-1]
            places.append(replace(place, column=np.where(place.column >= 0, place.column + precision.shape[1], -1)))
            precision = np.concatenate([precision, _scatter_columns(weight, place, units, width)], axis=1)
            target = np.concatenate([target, _scatter_columns(about, place, units, width)], axis=1)
            own.append(rows)
        else:
            places.append(replace(place, column=np.where(place.column >= 0, place.column + len(common_precision), -1)))
            chosen = place.column >= 0
            common_precision = np.concatenate([common_precision, weight[chosen]])
            common_target = np.concatenate([common_target, about[chosen]])
            shared.append(rows)
    free = [(rows, 0.0) for rows in _truth_error_columns(view)]
    going_round = going_round_columns(view)
    spread = list(_covariate_error_columns(view, accepted))
    if going_round is not None and not going_round.shared:
        spread.append(going_round.columns)
    elif going_round is not None:
        shared.append(going_round.columns)
        more = going_round.columns.visit.shape[-1]
        common_precision, common_target = np.r_[common_precision, np.ones(more)], np.r_[common_target, np.zeros(more)]
    for rows, weight_of_zero in (*free, *((rows, 1.0) for rows in spread)):
        own.append(rows)
        width = rows.visit.shape[-1]
        precision, target = (
            np.pad(x, ((0, 0), (0, width)), constant_values=c) for x, c in ((precision, weight_of_zero), (target, 0))
        )
    known = NuisanceColumns(
        DataColumns.concatenate(own),
        precision,
        target,
        DataColumns.concatenate(shared),
        common_precision,
        common_target,
        goes_round=going_round is not None and not any(item.candidate.moving for item in accepted),
    )
    return known, tuple(places)


def _truth_error_columns(view: ResidualView) -> Iterator[DataColumns]:
    """What moves a healthy gyroscope beside its rate, for each unit separately: gravity by its g-sensitivity, the Earth
    by what is not known of its turning. How much of each is left free: units differ, and some have none."""
    recipe, visits = view.scene.recipe, view.scene.visits
    if not (recipe.pose_known and recipe.feels_rotation):
        return
    pairs, at = np.unique(np.stack([visits.position.code, visits.seating.code]), axis=1, return_inverse=True)
    labels = visits.position, visits.seating
    position, seating = (tuple(of.names[i] for i in code) for of, code in zip(labels, pairs, strict=True))
    true = np.array([recipe.true_vector(recipe.position(p), s) for p, s in zip(position, seating, strict=True)])
    errors = sensor.of(recipe).truth_errors(recipe, position, seating, true)
    yield view.rows(np.moveaxis(np.concatenate(list(errors.values())), 0, -1)[at], None)


def _covariate_error_columns(view: ResidualView, accepted: tuple[AcceptedCause, ...]) -> Iterator[DataColumns]:
    """The errors of the accepted causes due to errors of their covariates, for each run of a unit separately."""
    code, names = view.scene.group("run")
    for acting in (acting for item in accepted for acting in item.active_effects().values()):
        visit = view.covariate_error(acting)
        if visit is not None:
            yield Candidate("blur", None, "run", "own", code, names, CauseColumns.of(visit)).rows(view.layout)


def accepted_columns(item: AcceptedCause, layout: RowLayout) -> tuple[DataColumns, CoefficientIndex]:
    """Columns of the groups that act, and their places counted from 0."""
    c = item.candidate
    axes = np.arange(c.axes)
    if c.of not in PER_UNIT_LEVELS:
        chosen = np.flatnonzero(item.hit)
        number = np.full(len(c.names), -1)
        number[chosen] = np.arange(len(chosen))
        column = np.where(item.hit[:, None], number[:, None] * c.axes + axes, -1)
        return c.rows(layout, chosen), CoefficientIndex(own=False, unit=np.zeros_like(column), column=column)
    unit, first = c.where(layout)
    used = np.unique(first[item.hit])
    number = np.full(int(first.max()) + 1, -1)
    number[used] = np.arange(len(used))
    column = np.where(item.hit[:, None], number[first][:, None] * c.axes + axes, -1)
    return _zero_inactive(c.rows(layout, used), unit, column), CoefficientIndex(
        own=True, unit=np.repeat(unit[:, None], c.axes, 1), column=column
    )


def _zero_inactive(rows: DataColumns, unit: NDArray[np.intp], column: NDArray[np.intp]) -> DataColumns:
    """Columns set to zero in units where their group does not act."""
    acts = np.zeros((rows.visit.shape[0], rows.visit.shape[-1]))
    on = column >= 0
    acts[np.broadcast_to(unit[:, None], column.shape)[on], column[on]] = 1.0
    dwell = None if rows.dwell is None else rows.dwell * acts[:, None, :]
    return DataColumns(rows.visit * acts[:, None, None, :], dwell)


def _scatter_columns(values: Floats, place: CoefficientIndex, units: int, width: int) -> Floats:
    """Values (groups, axes) where their columns stand (U, width)."""
    out = np.zeros((units, width))
    on = place.column >= 0
    out[place.unit[on], place.column[on]] = values[on]
    return out
