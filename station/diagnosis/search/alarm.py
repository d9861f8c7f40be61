"""When to say that something is wrong: the threshold comes from a parametric bootstrap.

Data sets without any cause are drawn from the floor, its own uncertainty included, and scored by the whole bank.
Each cause's scores give its own null distribution (an exponential tail beyond the sample); the statistic of a data
set is the largest −log₁₀ p over the bank, and the threshold its 99.25 % quantile over the null sets, so that the whole
family of causes raises a false alarm in one of a hundred campaigns. What explains too little to be named alarms nobody,
neither in the readings nor in the null sets: of a few visits a cause may say the same whatever is read, and rounding
alone then looks rare.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from station.diagnosis.candidates.kernels import KERNEL_NAMES
from station.diagnosis.candidates.projected_bank import ProjectedBank
from station.diagnosis.linear.noise_floor import FittedFloor
from station.diagnosis.search import null_simulation
from station.diagnosis.search.bounded_floor import LEAST_DETECTED, bound_sides
from station.diagnosis.search.scoring import ScoringProblem
from station.diagnosis.search.walk_marginal import WalkMarginal
from station.domain.core.types import Floats

#: Raised whenever a kept null distribution is no longer valid.
NULL_CACHE_VERSION = 17
#: What of a recipe the bank is made from: the same name may stand for other positions.
_DESIGN: dict[str, bool | set[str]] = {
    **dict.fromkeys(("sensor", "unit", "reference", "positions", "seatings", "runs", "settle", "dwell"), True),
    "device": {"g_sensitivity"},
}
#: Errors of a logarithm of the noise within the dwells are as good as the same within such a step.
ERROR_STEP = 0.05
#: A variance of one axis below this share of that in common adds nothing to what chance does.
LEAST_SIZE = 1 / 16
#: Chance of any alarm in data without a cause, and in sets that are drawn: real noise, whose tails, colour and floor
#: are not quite those that are drawn, alarms 1.3 times as often.
FAMILY_WISE_LEVEL, DRAWN_LEVEL = 0.01, 0.0075
#: A cause worth fewer nats than this, odds of three to one, explains no alarm.
EXPLAINS_NATS = 1.1
#: What readings say with fewer nats than this, odds of twenty to one, is no alarm, however rare drawn noise says it:
#: real noise is not quite that, and a cause that is there explains more before it is found.
ALARMS_NATS = 3.0
#: A kernel must be ahead of chance, and of every cause of the library, by this many nats to be "something unknown".
UNKNOWN_NATS = 3.0
#: Probabilities below the tail at which a cause's null scores are kept, and where its exponential tail begins.
QUANTILE_GRID = np.linspace(0.0, 1.0, 33)
TAIL_START = 0.975


@dataclass(frozen=True, slots=True, eq=False)
class NullDistribution:
    """What scores look like when nothing is wrong.

    quantiles (33) of each cause's null scores below its tail, start and scale of the tail; threshold of the largest
    −log₁₀ p.
    """

    quantiles: Mapping[str, Floats]
    start: Mapping[str, float]
    scale: Mapping[str, float]
    threshold: float

    def minus_log10_p(self, name: str, score: Floats) -> Floats:
        """−log₁₀ p of a cause's scores (n); 0 for a cause without a null distribution."""
        if name not in self.quantiles:
            return np.zeros_like(score)
        below = 1 - TAIL_START * np.interp(score, self.quantiles[name], QUANTILE_GRID)
        tail = np.maximum(score - self.start[name], 0.0) / (self.scale[name] * np.log(10))
        return np.asarray(-np.log10(below) + tail)

    def surprise(self, scores: Mapping[str, Floats], least: float = EXPLAINS_NATS) -> Floats:
        """The largest −log₁₀ p (n) of the causes' scores, of those worth at least so many nats, and of the kernels of
        those that explain enough to be named; 0 without any."""
        each = [
            np.where(s >= (UNKNOWN_NATS if name in KERNEL_NAMES else least), self.minus_log10_p(name, s), 0.0)
            for name, s in scores.items()
        ]
        return np.asarray(np.max(each, axis=0)) if each else np.zeros(1)

    def beside(self, surprise: float, level: float) -> float:
        """A surprise that alarms at a level of its own, as far above or below the threshold as above or below that; 0
        where it is none."""
        return surprise + self.threshold + float(np.log10(level)) if surprise > 0 else 0.0

    def document(self) -> dict[str, object]:
        """As plain numbers, to keep."""
        causes = {
            name: [*(float(x) for x in q), self.start[name], self.scale[name]] for name, q in self.quantiles.items()
        }
        return {"threshold": self.threshold, "causes": causes}

    @staticmethod
    def from_document(document: Mapping[str, object]) -> "NullDistribution":
        """From plain numbers. Errors: KeyError, TypeError or ValueError when it is none."""
        causes = document["causes"]
        if not isinstance(causes, Mapping):
            raise TypeError("causes is no mapping")
        rows = {str(name): np.asarray(row, float) for name, row in causes.items()}
        if any(len(row) != len(QUANTILE_GRID) + 2 for row in rows.values()):
            raise ValueError("causes have rows of another length")
        return NullDistribution(
            {name: row[:-2] for name, row in rows.items()},
            {name: float(row[-2]) for name, row in rows.items()},
            {name: float(row[-1]) for name, row in rows.items()},
            float(str(document["threshold"])),
        )


def bootstrap(
    problem: ScoringProblem, fitted: FittedFloor, now: WalkMarginal, seed: int, sets: int = null_simulation.NULL_SETS
) -> NullDistribution:
    """The null distribution for a bank under the floor fitted without any new cause, from so many null sets."""
    parts = list(null_simulation.scores(problem, fitted, now, seed, sets))
    return fit_null({name: np.concatenate([p[name] for p in parts]).astype(float) for name in parts[0]})


def fit_null(scores: Mapping[str, Floats]) -> NullDistribution:
    """The null distribution from each cause's scores (n) in the same null data sets.

    How rare a set looks is judged by the other half of the sets for the threshold: by its own tails no set looks as
    rare as a new one does.
    """
    halves = [{name: s[i::2] for name, s in scores.items()} for i in (0, 1)]
    surprise = [_tails_of(one).surprise(other) for one, other in (halves, halves[::-1])]
    return replace(
        _tails_of(scores),
        threshold=float(np.quantile(np.concatenate(surprise), 1 - DRAWN_LEVEL, method="weibull")),
    )


def _tails_of(scores: Mapping[str, Floats]) -> NullDistribution:
    """The null distribution without a threshold."""
    quantiles = {name: np.quantile(s, TAIL_START * QUANTILE_GRID) for name, s in scores.items()}
    start = {name: float(q[-1]) for name, q in quantiles.items()}
    beyond = {name: s[s > start[name]] - start[name] for name, s in scores.items()}
    scale = {name: max(float(np.mean(x)), 0.05) if len(x) else 1.0 for name, x in beyond.items()}
    # A tail bends towards that of every log Bayes factor; a few sets beyond its start do not show yet how far it goes.
    usual = float(np.median(list(scale.values())))
    return NullDistribution(quantiles, start, {name: max(x, usual) for name, x in scale.items()}, 0.0)


def statistic(null: NullDistribution, evidence: Mapping[str, float]) -> float:
    """The largest −log₁₀ p over the causes; no more than the threshold of what explains too little to alarm."""
    scores = {name: np.array([e]) for name, e in evidence.items()}
    some, enough = (float(null.surprise(scores, least)[0]) for least in (EXPLAINS_NATS, ALARMS_NATS))
    return max(enough, min(some, null.threshold))


def chance_of(statistic: float, threshold: float) -> float:
    """How often chance alone makes as large a statistic, by the tail of which the threshold is a quantile: a tenth for
    each step of 1."""
    return float(min(DRAWN_LEVEL * 10.0 ** (threshold - statistic), 1.0))


def cache_key(problem: ScoringProblem, fitted: FittedFloor, now: WalkMarginal, seed: int) -> str:
    """What the null distribution depends on, as text: bank and design exactly, floor and its errors to a factor."""
    grid, floor = problem.view.grid, fitted.floor
    recipe = problem.view.scene.recipe
    both = zip((floor.turn, floor.walk), LEAST_DETECTED, strict=True)
    relative = [round(2 * float(np.log2(max(x / floor.noise, least)))) for x, least in both]
    # Slow causes are judged under all walks up to the largest allowed.
    most = float(np.sqrt(problem.upper[2])) / floor.noise
    relative.append(round(float(np.log2(np.clip(most, LEAST_DETECTED[1], 1 / LEAST_DETECTED[1])))))
    shown = [(s.bank.moving, s.readings.size.dof, _candidate_kinds(s)) for s in now.best.projected]
    design = recipe.model_dump_json(include=_DESIGN)
    unsure = [round(e / ERROR_STEP) for e in problem.view.contrast_noise.errors]
    at_bounds = bound_sides(fitted, problem.upper)
    key = (NULL_CACHE_VERSION, at_bounds, design, grid.slot.shape, grid.data, grid.k, relative, unsure, shown, seed)
    # Sizes that axes have of their own, to a factor, too.
    return repr((*key, *(round(2 * float(np.log2(max(x, LEAST_SIZE)))) for x in problem.structure.sizes)))


def _candidate_kinds(projected: ProjectedBank) -> list[tuple[str, str, str, int]]:
    """Name, level, pattern and number of coefficients of every candidate."""
    pairs = zip(projected.bank.candidates, projected.spectra, strict=True)
    return [(c.name, c.of, c.pattern, s.m.size) for c, s in pairs]
