"""Readings that the next run may bring: what was measured stays, the rest is drawn from what is known of a cause.

With S the columns of a cause and N those of the units' calibrations, all as white noise sees them, the readings so far
give the posterior of the coefficients c and of the calibrations θ, c ~ N(0, size²) before them. A set draws both, and
in the planned runs a floor out of its uncertainty: new = N·θ + S·c + noise.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from station.diagnosis.candidates.bank import PER_UNIT_LEVELS, Candidate
from station.diagnosis.candidates.nuisance import accept_candidate, accepted_columns
from station.diagnosis.linear.noise_floor import NoiseFloor, covariance_root
from station.diagnosis.linear.projection import DataColumns, ResidualSpace
from station.diagnosis.linear.run_filter import RunFilter
from station.diagnosis.search.null_noise import NullNoise
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Array, Floats

#: The white variance of a true floor and that found differ by this factor at most.
LARGEST_NOISE_RATIO = 4.0
#: A direction that keeps less than this share of the clearest one is not known from the readings so far.
LEAST_KNOWN = 1e-9


@dataclass(frozen=True, eq=False)
class NextReadings:
    """Readings of a campaign of which so many runs are measured; floor: the one found, spread (3, 3): covariance of its
    variances."""

    problem: ScoringProblem
    floor: NoiseFloor
    spread: Floats
    measured: int

    @cached_property
    def _space(self) -> ResidualSpace:
        return self.problem.space(self.floor, moving=True)

    @cached_property
    def _is_new(self) -> tuple[Array, Array]:
        """Which rows of the visits (U, R, m) and of the contrasts (U, w) are of planned runs."""
        slot = self.problem.view.grid.slot
        visits = np.append(self.problem.view.scene.visits.run >= self.measured, False)[slot]
        U, R, V = slot.shape
        numbers = np.repeat(visits, self.problem.view.grid.k, axis=2)
        each = self._space.dwell // (R * V)
        return numbers, np.repeat(visits, each, axis=2).reshape(U, -1)

    def sets(self, candidate: Candidate, size: float, count: int, rng: np.random.Generator) -> NullNoise:
        """So many sets in which a cause is true whose coefficients have this rms."""
        rows, place = accepted_columns(
            accept_candidate(candidate, self.hit(candidate, size, rng), size), self.problem.view.layout
        )
        own = self.problem.known.own
        known = DataColumns.concatenate([own, rows])
        theta = self._drawn(known, own.visit.shape[-1], size, count, rng, own=place.own)
        return self._noise_with(known, theta, count, rng)

    def hit(self, candidate: Candidate, size: float, rng: np.random.Generator) -> Array:
        """The groups that act: of few of many one of those that were measured, as likely as its readings make it."""
        hit = np.ones(len(candidate.names), bool)
        if candidate.pattern == "scan":
            groups = np.unique(candidate.code[self.problem.view.scene.visits.run < max(self.measured, 1)])
            nats = self._evidence(candidate, groups, size) if self.measured else np.zeros(len(groups))
            likely = np.exp(nats - nats.max())
            hit[:] = False
            hit[rng.choice(groups, p=likely / likely.sum())] = True
        return hit

    def _evidence(self, candidate: Candidate, groups: Array, size: float) -> Floats:
        """Log evidence (groups) of each group's coefficients, of this rms, in the readings so far, beside its unit's
        calibration."""
        if candidate.of not in PER_UNIT_LEVELS:
            return np.zeros(len(groups))
        readings, _ = self.problem.readings(moving=True)
        own, every, y = (
            self._measured(x) for x in (self.problem.known.own, candidate.rows(self.problem.view.layout), readings)
        )
        calibration = np.linalg.pinv(own)
        every, y = (x - own @ (calibration @ x) for x in (every, y))
        unit, place = candidate.where(self.problem.view.layout)
        columns = place[groups, None] * candidate.axes + np.arange(candidate.axes)
        mine = size * every[unit[groups][:, None], :, columns].swapaxes(1, 2)
        information = np.eye(candidate.axes) + mine.swapaxes(1, 2) @ mine
        along = mine.swapaxes(1, 2) @ y[unit[groups]]
        explained = (along.swapaxes(1, 2) @ np.linalg.solve(information, along))[:, 0, 0]
        return np.asarray(0.5 * (explained - np.linalg.slogdet(information)[1]))

    def _drawn(
        self, known: DataColumns, p: int, size: float, count: int, rng: np.random.Generator, *, own: bool
    ) -> Floats:
        """Calibrations and coefficients (U, p + K, n) from the readings so far; without any, those of this rms."""
        if not self.measured:
            U, c = known.visit.shape[0], known.visit.shape[-1]
            drawn = rng.standard_normal((U if own else 1, c - p, count))
            drawn *= size / np.sqrt(np.mean(drawn**2, axis=(0, 1)))
            return np.concatenate([np.zeros((U, p, count)), np.broadcast_to(drawn, (U, c - p, count))], axis=1)
        readings, _ = self.problem.readings(moving=True)
        white, y = (self._measured(x) for x in (known, readings))
        U, _, c = white.shape
        prior = np.r_[np.zeros(p), np.full(c - p, 1 / max(size, 1e-300) ** 2)]
        if own:
            return _posterior(white, y[..., 0], prior, rng.standard_normal((U, c, count)))
        # One set of coefficients for all units: the units' calibrations stand beside each other.
        wide = np.zeros((U, white.shape[1], U * p + c - p))
        for u in range(U):
            wide[u, :, u * p : (u + 1) * p] = white[u, :, :p]
        wide[..., U * p :] = white[..., p:]
        prior = np.r_[np.zeros(U * p), prior[p:]]
        found = _posterior(
            wide.reshape(1, -1, wide.shape[2]), y.reshape(1, -1), prior, rng.standard_normal((1, len(prior), count))
        )[0]
        shared = np.broadcast_to(found[U * p :], (U, c - p, count))
        return np.concatenate([found[: U * p].reshape(U, p, count), shared], axis=1)

    def _measured(self, rows: DataColumns) -> Floats:
        """White rows (U, M, c) of the runs that were measured; the others are zero."""
        new_visits, new_inside = self._is_new
        visit = np.where(new_visits[..., None], 0.0, rows.visit)
        inside = None if rows.dwell is None else np.where(new_inside[..., None], 0.0, rows.dwell)
        return np.asarray(self._space.covariance.whiten(DataColumns(visit, inside), self._space.dwell))

    def _noise_with(self, known: DataColumns, theta: Floats, count: int, rng: np.random.Generator) -> NullNoise:
        """The sets: rows of the visits as they are, contrasts and priors in units of their noise."""
        space, (new_visits, new_inside) = self._space, self._is_new
        readings, _ = self.problem.readings(moving=True)
        U, R, m, _ = readings.visit.shape
        noise = rng.standard_normal((count, *space.live.shape), dtype=np.float32) * space.live
        drawn = NullNoise.of(noise, replace(self._true_floor(rng), member=space.covariance.runs.member))
        expected = np.einsum("urmc,ucn->urmn", known.visit, theta)
        visits = np.where(new_visits[..., None], drawn.visits + expected, readings.visit)
        if space.dwell and readings.dwell is not None:
            inside = np.zeros((U, space.dwell, count)) if known.dwell is None else known.dwell @ theta
            inside = inside.transpose(2, 0, 1) + noise[:, :, R * m : R * m + space.dwell]
            old = readings.dwell[..., 0]
            noise[:, :, R * m : R * m + space.dwell] = np.where(new_inside, inside, old) * (old != 0)
        return NullNoise(noise, visits.astype(np.float32))

    def _true_floor(self, rng: np.random.Generator) -> RunFilter:
        """One of the floors that the readings so far allow."""
        mean = self.floor.variances
        root = covariance_root(self.spread)
        step = root @ rng.standard_normal(3)
        low = np.array([mean[0] / LARGEST_NOISE_RATIO, 0.0, 0.0])
        high = np.r_[mean[0] * LARGEST_NOISE_RATIO, self.problem.upper[1:]]
        step = np.where(np.where(step > 0, mean >= high, mean <= low), -step, step)
        # Of a few visits noise and turns may be told by their sum alone: a step beyond the bounds ends anywhere on the
        # way to them.
        room = np.where(step > 0, high - mean, mean - low) / np.maximum(np.abs(step), 1e-300)
        share = min(max(float(room.min()), 0.0) * float(rng.uniform()), 1.0) if room.min() < 1 else 1.0
        variances = np.clip(mean + share * step, low, high)
        return self.problem.structure.covariance(variances).runs.single_precision()


def _posterior(columns: Floats, y: Floats, prior: Floats, normal: Floats) -> Floats:
    """Coefficients (b, c, n) drawn from their posterior by white columns (b, M, c), readings (b, M), the precisions (c)
    before them and standard normal numbers (b, c, n). What nothing tells is 0."""
    scale = np.sqrt(np.einsum("bmc,bmc->bc", columns, columns) + prior)
    scale = np.where(scale > 0, scale, 1.0)
    unit = columns / scale[:, None]
    information = unit.swapaxes(1, 2) @ unit + np.eye(len(prior)) * (prior / scale**2)[:, None]
    m, E = np.linalg.eigh(information)
    inverse = np.where(m > LEAST_KNOWN * m.max(axis=1, keepdims=True, initial=1e-300), 1 / np.maximum(m, 1e-300), 0.0)
    along = E.swapaxes(1, 2) @ np.einsum("bmc,bm->bc", unit, y)[..., None]
    drawn = E @ (inverse[..., None] * along + np.sqrt(inverse)[..., None] * normal)
    return np.asarray(drawn / scale[..., None])
