"""The whole bank under one noise floor."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis import floor
from station.diagnosis.bank import Bank, Candidate, Seen, see
from station.diagnosis.evidence import Sets, Spectrum, log_mean
from station.diagnosis.floor import Floor, Structure
from station.diagnosis.known import Accepted, Place, accept, known_of
from station.diagnosis.space import Known, Rows, Space, space
from station.diagnosis.view import View
from station.domain.types import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """View, its floor's structure, what is known and where, and the upper bounds (3) of the floor's variances."""

    view: View
    structure: Structure
    accepted: tuple[Accepted, ...]
    known: Known
    places: tuple[Place, ...]
    matrix: bool
    upper: Floats

    def readings(self, *, moving: bool) -> tuple[Rows, int]:
        """What a cause that moves within a stop, or not, is judged by: means with contrasts, or means alone; and
        how many numbers that is."""
        readings = self.view.readings()
        if not (moving or self.known.moving) or readings.dwell is None:
            return Rows(readings.stop), self.view.grid.data
        return readings, self.view.grid.data + int(np.count_nonzero(readings.dwell))

    def fit(self, start: Floor | None = None, upper: Floats | None = None) -> floor.Fitted:
        """The floor that fits best."""
        rows, count = self.readings(moving=False)
        return floor.fit(self.structure, self.known, rows, count, self.upper if upper is None else upper, start)

    def space(self, at: Floor, *, moving: bool) -> Space:
        """The readings under a floor."""
        return space(self.structure.covariance(at.variances), self.known, *self.readings(moving=moving))

    def beside(self, items: Sequence[Accepted]) -> "Problem":
        """The same with other causes accepted, their columns as they are."""
        known, places = known_of(self.view, tuple(items), self.matrix)
        return replace(self, accepted=tuple(items), known=known, places=places)

    def without(self, i: int) -> "Problem":
        """The same with one accepted cause neither known nor at work: its whole signal is in the readings."""
        active = {key: acting for key, acting in self.view.active.items() if key != self.accepted[i].key}
        bare = replace(self, view=replace(self.view, active=active))
        return bare.beside([*self.accepted[:i], *self.accepted[i + 1 :]])


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """Candidates under one floor: still ones see the stops' means, moving ones the contrasts too."""

    floor: Floor
    seen: tuple[Seen, ...]

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """All of them, in the order of the evidence."""
        return tuple(c for s in self.seen for c in s.bank.candidates)

    def light(self) -> "Stage":
        """The same in single precision, which is enough for chance."""
        return Stage(self.floor, tuple(s.light() for s in self.seen))

    def readings(self) -> list[Sets]:
        """The readings as the data set of each space."""
        return [Sets.of(s.space, s.space.data[None]) for s in self.seen]

    def evidence(self, sets: Sequence[Sets] | None = None) -> Floats:
        """Log evidence (n, candidates) of data sets given for each space, or of the readings."""
        given = self.readings() if sets is None else sets
        return np.concatenate([s.evidence(d) for s, d in zip(self.seen, given, strict=True)], axis=1)

    def fits(self, sets: Sequence[Sets]) -> Floats:
        """Log-likelihood (n, spaces) of data sets without any candidate, the floor's scale at its best."""
        each = zip(self.seen, sets, strict=True)
        return np.stack([-0.5 * (s.space.logdet + s.space.dof * np.log(d.rest)) for s, d in each], axis=1)

    def accept(self, candidate: Candidate, view: View) -> Accepted:
        """The candidate with its likeliest amplitude, and the groups that it likely hits."""
        spectrum, likelihood, rest = self._likelihood(candidate)
        hit = self.hit(candidate, view)
        taken = spectrum.logdet
        if spectrum.pattern == "scan":
            unit, place = candidate.where(view)
            likelihood, taken = (x[unit[hit], place[hit]] for x in (likelihood, taken))
        likelihood, taken = (x.reshape(-1, x.shape[-1]).sum(0) for x in (likelihood, taken))
        i, dof = int(likelihood.argmax()), spectrum.space.dof
        # The scale of the floor that goes with the amplitude: L = −½ n·log(scale · n / rest) − ½ log|1 + ρ m|.
        scale = rest / dof * float(np.exp(-2 * (likelihood[i] + 0.5 * taken[i]) / dof))
        spread = float(np.sqrt(spectrum.ratios[i] / spectrum.mean * scale))
        return accept(candidate, hit, min(spread, candidate.most))

    def hit(self, candidate: Candidate, view: View, alone: bool = False) -> NDArray[np.bool_]:
        """The groups that a candidate likely hits, or the likeliest one `alone`; all where it is not a scan."""
        spectrum, likelihood, _ = self._likelihood(candidate)
        if spectrum.pattern != "scan":
            return np.ones(len(candidate.names), bool)
        odds = log_mean(likelihood)[candidate.where(view)]
        return np.asarray((odds == odds.max()) | (not alone) & (odds > np.log(len(odds))))

    def _likelihood(self, candidate: Candidate) -> tuple[Spectrum, Floats, float]:
        """What a candidate can show, its L over the amplitudes, and the sum of squares without it."""
        seen, i = next((s, i) for s in self.seen for i, c in enumerate(s.bank.candidates) if c is candidate)
        sets = Sets.of(seen.space, seen.space.data[None])
        spectrum, u = seen.spectra[i], seen.components(sets)[i]
        return spectrum, spectrum.likelihood(u, sets)[0], float(sets.rest[0])


def stage(problem: Problem, banks: Sequence[Bank], at: Floor) -> Stage:
    """The bank under a floor."""
    covariance = problem.structure.covariance(at.variances)
    seen = (see(b, space(covariance, problem.known, *problem.readings(moving=b.moving))) for b in banks)
    return Stage(at, tuple(seen))


def by_cause(candidates: Sequence[Candidate], evidence: Floats) -> dict[str, Floats]:
    """Log evidence (n) of each cause: the mean over its candidates' (n, candidates)."""
    rows: dict[str, list[int]] = {}
    for i, c in enumerate(candidates):
        rows.setdefault(c.name, []).append(i)
    return {name: log_mean(evidence[:, at]) for name, at in rows.items()}
