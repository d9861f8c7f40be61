"""The whole diagnosis of a samples table: gross faults, floor, causes, sizes, gains, verdict."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from station import plugins
from station.diagnosis.candidates.bank import PER_UNIT_LEVELS
from station.diagnosis.candidates.kernels import acts_by
from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.data import input_checks
from station.diagnosis.data.faults import GrossFault, Inspection, inspect
from station.diagnosis.data.reduce import ReducedScene, reduce_samples
from station.diagnosis.data.sample_source import SampleSource
from station.diagnosis.data.stays import recut
from station.diagnosis.linear.noise_floor import FittedFloor, NoiseFloor
from station.diagnosis.results.confounded_covariates import with_confounded
from station.diagnosis.results.estimate import Estimate, estimate_causes
from station.diagnosis.results.gold_direction import GoldDirections, gold_directions, settle
from station.diagnosis.search.alarm import EXPLAINS_NATS, FAMILY_WISE_LEVEL
from station.diagnosis.search.cause_search import SearchResult
from station.diagnosis.search.finding import CauseFinding
from station.diagnosis.search.fleet_search import search_by_sample
from station.diagnosis.search.held_out_gain import HeldOutGain, gain_together
from station.diagnosis.search.problem import FloorAllowance, initial_problem, with_model
from station.diagnosis.search.scatter_gain import scatter_gain
from station.diagnosis.search.scoring import ScoringProblem
from station.diagnosis.search.search_state import CauseSearch, LawAlone, NullFactory
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe
from station.model.effect import Effect
from station.model.model_file import EFFECTS, Model

if TYPE_CHECKING:
    from station.diagnosis.results.hypotheses import Hypotheses

DiagnosisVerdict = Literal["none", "named", "incomplete", "unknown"]


@dataclass(frozen=True, slots=True, eq=False)
class Cause:
    """A cause found: the finding, its size (None for a variance of the floor) and its gain."""

    finding: CauseFinding
    estimate: Estimate | None
    gain: HeldOutGain


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """Everything that was found, with all that a report can draw.

    faults: gross ones; searched: the search for the rest; last: the problem with every cause in the simulation at
    its best; floor: the noise floor there; depends_on: words of what no cause explains; not_testable: effect ids;
    hypotheses: formulas proposed for what no cause explains, None where nothing is unknown.
    """

    recipe: Recipe
    samples: SampleSource
    inspection: Inspection
    search_result: SearchResult
    last: ScoringProblem
    floor: FittedFloor
    causes: tuple[Cause, ...]
    depends_on: tuple[str, ...]
    not_testable: tuple[str, ...]
    hypotheses: "Hypotheses | None" = None

    @property
    def table(self) -> SampleTable:
        """All samples at once."""
        return self.samples.table

    @property
    def faults(self) -> tuple[GrossFault, ...]:
        """The gross faults."""
        return self.inspection.faults

    @property
    def verdict(self) -> DiagnosisVerdict:
        """none, named, incomplete or unknown; docs/formats.md."""
        found = bool(self.causes or self.faults)
        if self.depends_on:
            return "incomplete" if found else "unknown"
        return "named" if found else "none"

    @property
    def level(self) -> float:
        """Chance of any alarm where nothing is wrong."""
        return FAMILY_WISE_LEVEL


def diagnose(
    recipe: Recipe, table: SampleTable, model: Model, null_of: NullFactory, seen: tuple[GrossFault, ...] = ()
) -> Diagnosis:
    """Diagnoses a table; seen: faults of visits that were left out of it.

    Errors: SamplesError when a position or seating is not in the recipe, or when the table holds hardly anything.
    """
    input_checks.check(recipe, table)
    cut = recut(recipe, table.used())
    inspected = inspect(recipe, cut.table)
    input_checks.check_unclipped(table, inspected.table)
    reduced = reduce_samples(recipe, inspected.table)
    whole = cut.as_it_came and len(inspected.table) == len(cut.table)
    inspected = replace(inspected, faults=(*seen, *inspected.faults), as_measured=not inspected.faults and whole)
    gold = gold_directions(recipe, inspected.table)
    return diagnose_reduced(recipe, SampleSource.of(table), inspected, reduced, model, null_of, gold)


def diagnose_reduced(
    recipe: Recipe,
    samples: SampleSource,
    inspected: Inspection,
    reduced: ReducedScene,
    model: Model,
    null_of: NullFactory,
    gold: GoldDirections | None = None,
) -> Diagnosis:
    """The same for samples that were already inspected and reduced; gold: its directions, where they count."""
    known = {effect.effect for effect in model.effects}
    news = tuple(f for f in inspected.faults if f.effect not in known)
    problem = initial_problem(reduced, FloorAllowance.of(recipe, model), matrix=model.calibration == "matrix")
    input_checks.check_calibrated(problem.view)
    problem = with_model(problem, model)
    searched = settle(search_by_sample(problem, null_of, _law_alone), gold)
    last, sized = estimate_causes(searched.last)
    floor = last.fit()
    causes = _causes(searched, last, floor, sized[len(problem.accepted) :])
    found = Diagnosis(
        recipe=recipe,
        samples=samples,
        inspection=replace(inspected, faults=news),
        search_result=searched,
        last=last,
        floor=floor,
        causes=causes,
        depends_on=_remainder(searched, news, causes),
        not_testable=_not_testable(inspected, searched),
    )
    paying = [c.estimate.item for c in causes if c.estimate is not None and c.gain.accepted]
    return _with_doubts(_with_formulas(found, paying))


def _law_alone(search: CauseSearch, cause_nats: float, kernel_nats: float) -> LawAlone | None:
    """See `law_alone`."""
    # A search over thousands of formulas is loaded only where one is needed.
    from station.diagnosis.results.first_formula import law_alone

    return law_alone(search, cause_nats, kernel_nats)


def _with_formulas(d: Diagnosis, paying: list[AcceptedCause]) -> Diagnosis:
    """The diagnosis with formulas for what no cause explains, and without the causes that only imitate one."""
    if not d.depends_on and not paying:
        return d
    # A search over thousands of formulas is loaded only where one is needed.
    from station.diagnosis.results.hypotheses import only_with
    from station.diagnosis.results.imitators import simplest_explanation

    doubtful = [cause for cause in d.causes if cause.finding.doubts]
    doubted = [cause.estimate.item for cause in doubtful if cause.estimate is not None] if doubtful else None
    explanation = simplest_explanation(
        d.search_result, d.last, paying, d.samples, whole=not d.depends_on, doubted=doubted
    )
    found = explanation.formula
    words = d.depends_on if found is None else found.words_of_rest(d.depends_on)
    # Beside a formula, a cause that nothing held out confirms is a shadow of it.
    shadows = found is not None and bool(found.terms and d.causes) and not paying
    if len(explanation.causes) == len(paying) and not shadows:
        return replace(d, hypotheses=found, depends_on=words)
    staying = {id(item) for item in explanation.causes}
    last = only_with(d.last, len(d.search_result.first.accepted), explanation.causes)
    causes = tuple(c for c in d.causes if c.estimate is not None and id(c.estimate.item) in staying)
    return replace(d, last=last, floor=last.fit(), causes=causes, hypotheses=found, depends_on=words)


def _with_doubts(d: Diagnosis) -> Diagnosis:
    """The diagnosis with what the remainder depends on, where an unlikely cause does not follow it: its name is not the
    whole truth."""
    words = (*d.depends_on, *(word for cause in d.causes for word in cause.finding.doubts))
    return replace(d, depends_on=with_confounded(tuple(dict.fromkeys(words)), d.last.view))


def _not_testable(inspected: Inspection, searched: SearchResult) -> tuple[str, ...]:
    """Causes that nothing in these data could show, of those that the recipe's sensor feels at all."""
    shown = {*inspected.tested, *(f.effect for f in inspected.faults)}
    hidden = {*inspected.undetectable, *searched.undetectable} - shown
    return tuple(sorted(name for name in hidden if _is_felt(name, searched.first.view.scene.recipe)))


def _is_felt(name: str, recipe: Recipe) -> bool:
    kind: type[Effect] = plugins.load(EFFECTS, name)
    return kind.acts_on(recipe)


def _causes(
    searched: SearchResult, last: ScoringProblem, floor: FittedFloor, sized: tuple[Estimate, ...]
) -> tuple[Cause, ...]:
    """The named findings with sizes and gains."""
    out: list[Cause] = []
    consumed, before = 0, len(searched.first.accepted)
    for finding in searched.findings:
        if finding.words:
            continue
        if finding.accepted is None:
            if _still_exceeds_allowance(finding, searched, floor):
                gain = scatter_gain(last, finding.name, searched.first.upper, residual_rms(last))
                out.append(_cause(finding, None, gain))
            continue
        out.append(_cause(finding, sized[consumed], _gain(last, before, before + consumed, floor.floor)))
        consumed += 1
    # Beside a cause that pays, one that does not is a shadow of it; alone, one that gains nothing is no finding at all.
    paying = tuple(cause for cause in out if cause.gain.accepted)
    return paying or tuple(cause for cause in out if cause.gain.log_score > EXPLAINS_NATS)


def _cause(finding: CauseFinding, estimate: Estimate | None, gain: HeldOutGain) -> Cause:
    """A cause; its probability is at most that of any gain on held-out data."""
    return Cause(finding if gain.accepted else finding.at_most(gain.chance), estimate, gain)


def _gain(last: ScoringProblem, first: int, i: int, floor: NoiseFloor) -> HeldOutGain:
    """The gain of accepted cause i among those from the first one on that were found. What all units share and what
    each has beside it are counted together, because each is half of the other."""
    name = last.accepted[i].candidate.name
    same = [k for k in range(first, len(last.accepted)) if last.accepted[k].candidate.name == name]
    same.sort(key=lambda k: last.accepted[k].candidate.of not in PER_UNIT_LEVELS)
    return gain_together(last, same, floor)


def _remainder(searched: SearchResult, faults: tuple[GrossFault, ...], causes: tuple[Cause, ...]) -> tuple[str, ...]:
    """What the remainder depends on: a kernel that is left, or the kernels that follow an alarm whose cause gains
    nothing on held-out data, or what such a cause itself acts by."""
    unconfirmed = [f.effect for f in faults if f.gain is None]
    if not searched.findings or any(cause.gain.accepted for cause in causes):
        return tuple(dict.fromkeys((*searched.words, *map(_acts_by, unconfirmed))))
    # What was left beside causes of which none stands says less than what there was before them.
    words = tuple(dict.fromkeys((*searched.findings[0].covariates, *searched.words)))
    unconfirmed += [cause.finding.name for cause in causes]
    return words or tuple(dict.fromkeys(map(_acts_by, unconfirmed)))


def _acts_by(effect_id: str) -> str:
    """The word of `unknown.depends_on` for what a cause acts by."""
    return acts_by(plugins.load_all("station.model.effects")[effect_id])


def _still_exceeds_allowance(finding: CauseFinding, searched: SearchResult, floor: FittedFloor) -> bool:
    """Whether a variance of the floor still exceeds what a healthy rig may have, with every cause known."""
    part = 1 if finding.name == "repeatability" else 2
    return bool(floor.floor.variances[part] > searched.first.upper[part])


def residual_rms(problem: ScoringProblem) -> float:
    """Rms of measured − simulated over the visits, in the recipe's unit, once everything known is fitted."""
    rows = problem.view.readings().visit[..., 0]
    live = problem.structure.pad[problem.structure.member] == 0
    return float(np.sqrt(np.mean(rows[live] ** 2))) if live.any() else 0.0


def floor_rms(problem: ScoringProblem, floor: FittedFloor) -> float:
    """Rms of a visit's mean that the noise floor alone makes, the walk apart."""
    diagonal = problem.structure.visit_variance(floor.floor.variances)
    live = problem.structure.pad == 0
    return float(np.sqrt(diagonal[live].mean())) if live.any() else 0.0


def calibration_shift(problem: ScoringProblem, before: ScoringProblem) -> Mapping[str, Floats]:
    """How far the causes move the calibration of each unit: offset and gain (6)."""
    now, then = problem.view.base, before.view.base
    gain = np.diagonal(now.matrix - then.matrix, axis1=1, axis2=2)
    moved = np.concatenate([now.offset - then.offset, gain], axis=1)
    return dict(zip(problem.view.scene.visits.unit.names, moved, strict=True))
