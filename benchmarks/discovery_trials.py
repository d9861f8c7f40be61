"""One campaign with a law in it, the formula found for it, and what became of it as one line of JSON.

Lines of many runs are put together, so that a long measurement may be made in portions; `discovery_figures.py` sums
them up.
"""

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from discovery_laws import Law, campaign

from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.discovery import chance
from station.diagnosis.discovery.discover import AlarmOnRest, Discovery, discover
from station.diagnosis.discovery.term_fit import candidate_of
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.linear.projection import ResidualSpace
from station.diagnosis.search.alarm import NullDistribution
from station.diagnosis.search.candidate_banks import CandidateBanks
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.diagnosis.search.scoring import ScoringProblem, score_bank
from station.diagnosis.search.walk_marginal import marginalise_walks
from station.domain.core.types import Floats
from station.model.model_file import Model
from tests.blind.bench import World
from tests.blind.inspection import null_of
from tests.blind.recipes import recipe

UNITS = 4
#: Two signals are one where no data of any length could tell them apart on these visits.
SAME_SIGNAL = 0.9995


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one campaign.

    found: families of the best formula, none where none was proposed; right: it is the law; covers: the set holds the
    law; cosine: of the law and what the formula can follow of it by the covariates as measured; followed: the same by
    the true ones, as an error of the thermometer is none of the form; alternatives: size of the set; gain: held-out
    gain over that of the true law; quiet: whether the formula was called complete; verdict: of the whole diagnosis;
    rivals: cosine of each.
    """

    part: str
    d: float
    seed: int
    law: str = ""
    found: tuple[str, ...] = ()
    right: bool = False
    covers: bool = False
    cosine: float = 0.0
    followed: float = 0.0
    alternatives: int = 0
    gain: float = 0.0
    quiet: bool = False
    seconds: float = 0.0
    verdict: str = ""
    rivals: Mapping[str, float] = field(default_factory=dict)

    @property
    def missed(self) -> float:
        """Length of what the formula cannot follow of the law, in white data."""
        return self.d * float(np.sqrt(max(0.0, 1 - self.followed**2)))

    @property
    def missed_as_measured(self) -> float:
        """The same with the errors of the covariates in it, which the law's own form has, too."""
        return self.d * float(np.sqrt(max(0.0, 1 - self.cosine**2)))


def read_outcomes(files: Sequence[Path]) -> list[Outcome]:
    """The lines of some files; a campaign that stands twice counts once."""
    lines = [json.loads(line) for file in files for line in file.read_text(encoding="utf-8").splitlines()]
    once = {(x["part"], x["d"], x["seed"], x["law"]): Outcome(**{**x, "found": tuple(x["found"])}) for x in lines}
    return list(once.values())


def outcome_line(outcome: Outcome) -> str:
    """One line of JSON."""
    return json.dumps(asdict(outcome)) + "\n"


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """A campaign with a law in it, and what became of it: true white signal (U·M), space of the true floor, view with
    the true covariates."""

    law: Law | None
    d: float
    problem: ScoringProblem
    found: Discovery
    truth: Floats
    space: ResidualSpace
    exact: ResidualView
    seconds: float


class Bench:
    """Campaigns, and the thresholds that are the same for all of them."""

    def __init__(self) -> None:
        self.threshold: float | None = None
        self.null: NullDistribution | None = None

    def trial(self, kind: Callable[[World, Any], Law] | None, d: float, seed: int) -> Trial:
        """One campaign."""
        made = campaign(kind, d, seed, UNITS)
        problem = initial_problem(reduce_samples(recipe(), made.table), FloorAllowance.of(recipe(), Model()))
        alarm = self.alarm_of(problem)
        start = time.process_time()
        found = discover(problem, alarm, 1, self.threshold_of)
        seconds = time.process_time() - start
        count = np.bincount(made.world.stop)
        means = np.stack([np.bincount(made.world.stop, c) / count for c in made.added.T], 1)
        floor = NoiseFloor(problem.view.reduced.sigma / float(np.sqrt(count.mean())), 0.0, 0.0)
        space = problem.space(floor, moving=False)
        truth = space.project(problem.view.rows(means[..., None], None))[..., 0].ravel()
        exact = _with_true_covariates(problem.view, made.world)
        return Trial(made.law, d, problem, found, truth, space, exact, seconds)

    def threshold_of(self, problem: Any, fitted: Any, scans: Any) -> float:
        """The score by chance, drawn once."""
        if self.threshold is None:
            self.threshold = chance.threshold(problem, fitted, scans, 1)
        return self.threshold

    def alarm_of(self, problem: ScoringProblem) -> AlarmOnRest:
        """The diagnosis' alarm, its null distribution drawn once."""
        banks = CandidateBanks(problem.view)
        if self.null is None:
            fitted = problem.fit()
            now = marginalise_walks(problem, score_bank(problem, banks.of(problem.view, ()), fitted.floor))
            self.null = null_of(problem, fitted, now)
        return AlarmOnRest(self.null, (), banks)


def _with_true_covariates(view: ResidualView, w: World) -> ResidualView:
    """A view as exact meters of temperature and motor would have told it."""
    count = np.bincount(w.stop)
    T, rate, motor = (np.bincount(w.stop, x) / count for x in (w.T, w.rate, w.motor))
    scene = replace(view.scene, temperature_degC=T, temperature_rate=rate, motor=motor)
    return replace(view, reduced=replace(view.reduced, scene=scene))


def columns(t: Trial, terms: Sequence[Any], view: ResidualView) -> Floats:
    """White columns (U·M, K) of some terms in a trial's true space, by the covariates of a view."""
    parts = []
    for term in terms:
        c = candidate_of(term, view, 1e-3)
        white = t.space.project(c.rows(view.layout))
        if c.pattern == "own":
            U, M, K = white.shape
            wide = np.zeros((U, M, U, K))
            wide[np.arange(U), :, np.arange(U)] = white
            white = wide.reshape(U, M, U * K)
        parts.append(white.reshape(t.truth.size, -1))
    return np.concatenate(parts, axis=1)


def cosine(t: Trial, terms: Sequence[Any], view: ResidualView | None = None) -> float:
    """Cosine of the truth and what the terms can follow of it, by the covariates as measured or those of a view."""
    if not terms:
        return 0.0
    Z = columns(t, terms, view or t.problem.view)
    onto = Z @ np.linalg.lstsq(Z, t.truth, rcond=1e-9)[0]
    return float(np.linalg.norm(onto)) / max(float(np.linalg.norm(t.truth)), 1e-300)


def is_right(t: Trial, terms: Sequence[Any]) -> bool:
    """Whether terms are the true families, or follow the true signal so that no data could tell."""
    assert t.law is not None
    return sorted(x.family for x in terms) == sorted(t.law.families) or cosine(t, terms) > SAME_SIGNAL


def formulas(t: Trial) -> Iterator[list[Any]]:
    """The formula found and those given as one with it."""
    own = [x.fit.term for x in t.found.terms]
    yield own
    for i, x in enumerate(t.found.terms):
        for f in x.equivalent:
            yield [*own[:i], f.term, *own[i + 1 :]]


def gain_ratio(t: Trial) -> float:
    """Expected gain on fresh data of the formula fitted to these, over that of the true law fitted to these."""
    data = t.space.residual.ravel()

    def gain(prediction: Floats) -> float:
        return float(2 * t.truth @ prediction - prediction @ prediction)

    Z = columns(t, [x.fit.term for x in t.found.terms], t.problem.view)
    found = Z @ np.linalg.lstsq(Z, data, rcond=1e-9)[0]
    unit = t.truth / np.linalg.norm(t.truth)
    return gain(found) / gain(unit * float(unit @ data))


def outcome_of(part: str, seed: int, t: Trial) -> Outcome:
    """What became of a trial."""
    best = [x.fit.term for x in t.found.terms]
    names = tuple("·".join(term.family) for term in best)
    if t.law is None or not best:
        law = "" if t.law is None else t.law.name
        return Outcome(part, t.d, seed, law, names, quiet=t.found.complete, seconds=t.seconds)
    some = list(formulas(t))
    return Outcome(
        part,
        t.d,
        seed,
        t.law.name,
        names,
        is_right(t, best),
        any(is_right(t, terms) for terms in some),
        cosine(t, best),
        cosine(t, best, t.exact),
        len(some),
        gain_ratio(t),
        t.found.complete,
        t.seconds,
    )
