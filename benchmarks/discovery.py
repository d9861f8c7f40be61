"""Formulas of laws that nobody wrote down: right family, sets, false alarms, held-out gain, rivals, time.

    python benchmarks/discovery.py [--laws 200] [--nulls 2000] [--rivals 6] [--seed 1] [--only laws whole nulls library]

Laws are made by `discovery_laws.py`, which shares no line with the grammar: in the grammar with constants off every
grid, of two terms, not expressible, and none. Four units go through tilt-24 three times; d is the length of what a law
leaves in white means of the visits. Readings go through the station's own reduction and calibration; the formula is
looked for in what that leaves. A law counts as detected where a formula is proposed. `library`: each cause of the
library that moves means, at its usual size, by a station that knows none. `xsens`: a real recording (--data DIR) whose
simulation has nothing but offset and gains. `whole`: through the whole diagnosis, where causes of the library may
imitate a law: a verdict is right that names none and holds the law in its set.
"""

import argparse
import os
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import figures
import numpy as np
from discovery_laws import Law, campaign, in_grammar, not_expressible, two_terms

from station.config.recipes import load_recipe
from station.diagnosis.data.faults import inspect
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.data.stays import recut
from station.diagnosis.discovery import chance
from station.diagnosis.discovery.discover import MOST_SCANNED_UNITS, Discovery, discover
from station.diagnosis.discovery.library import libraries
from station.diagnosis.discovery.scan import scan_of, scanned_units
from station.diagnosis.discovery.term_fit import candidate_of
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.linear.projection import ResidualSpace
from station.diagnosis.results.diagnose import Diagnosis, diagnose
from station.diagnosis.results.remaining_residual import remaining_rms
from station.diagnosis.search.alarm import NullDistribution
from station.diagnosis.search.cause_search import build_banks
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.diagnosis.search.scoring import ScoringProblem, score_bank
from station.diagnosis.search.walk_marginal import marginalise_walks
from station.domain.core.types import Floats
from station.model.formula.text import formula_text
from station.model.model_file import Model
from station.wiring.sample_files import read_samples
from tests.blind import rediscovery
from tests.blind.bench import World
from tests.blind.inspection import null_of
from tests.blind.recipes import recipe

UNITS = 4
#: Two signals are one where no data of any length could tell them apart on these visits.
SAME_SIGNAL = 0.9995
STRENGTHS = (11.0, 16.0, 32.0)
GOALS = {11.0: (0.80, 0.90), 16.0: (0.88, 0.95), 32.0: (0.94, 0.95)}


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """A campaign with a law in it, and what became of it: true white signal (U·M), space of the true floor."""

    law: Law | None
    d: float
    problem: ScoringProblem
    found: Discovery
    truth: Floats
    space: ResidualSpace
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
        null = self.alarm_of(problem)
        start = time.process_time()
        found = discover(problem, null, (), 1, self.threshold_of)
        seconds = time.process_time() - start
        count = np.bincount(made.world.stop)
        means = np.stack([np.bincount(made.world.stop, c) / count for c in made.added.T], 1)
        floor = NoiseFloor(problem.view.reduced.sigma / float(np.sqrt(count.mean())), 0.0, 0.0)
        space = problem.space(floor, moving=False)
        truth = space.project(problem.view.rows(means[..., None], None))[..., 0].ravel()
        return Trial(made.law, d, problem, found, truth, space, seconds)

    def threshold_of(self, problem: Any, fitted: Any, scans: Any) -> float:
        """The score by chance, drawn once."""
        if self.threshold is None:
            self.threshold = chance.threshold(problem, fitted, scans, 1)
        return self.threshold

    def alarm_of(self, problem: ScoringProblem) -> NullDistribution:
        """The null distribution of the diagnosis' alarm, drawn once."""
        if self.null is None:
            fitted = problem.fit()
            now = marginalise_walks(problem, score_bank(problem, build_banks(problem.view, ()), fitted.floor))
            self.null = null_of(problem, fitted, now)
        return self.null


def columns(t: Trial, terms: Sequence[Any]) -> Floats:
    """White columns (U·M, K) of some terms in a trial's true space."""
    parts = []
    for term in terms:
        c = candidate_of(term, t.problem.view, 1e-3)
        white = t.space.project(c.rows(t.problem.view.layout))
        if c.pattern == "own":
            U, M, K = white.shape
            wide = np.zeros((U, M, U, K))
            wide[np.arange(U), :, np.arange(U)] = white
            white = wide.reshape(U, M, U * K)
        parts.append(white.reshape(t.truth.size, -1))
    return np.concatenate(parts, axis=1)


def cosine(t: Trial, terms: Sequence[Any]) -> float:
    """Cosine of the truth and what the terms can follow of it."""
    if not terms:
        return 0.0
    Z = columns(t, terms)
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

    Z = columns(t, [x.fit.term for x in t.found.terms])
    found = Z @ np.linalg.lstsq(Z, data, rcond=1e-9)[0]
    unit = t.truth / np.linalg.norm(t.truth)
    return gain(found) / gain(unit * float(unit @ data))


def laws(bench: Bench, count: int, seed: int) -> None:
    """One term in the grammar, two terms, not expressible."""
    seconds: list[float] = []
    for d in STRENGTHS:
        trials = [bench.trial(in_grammar, d, seed * 100_000 + i) for i in _progress(range(count), f"d {d:g}")]
        _single_rows(d, trials)
        seconds += [t.seconds for t in trials]
    median = float(np.median(seconds))
    _row("processor time of a search, s", median, "<= 5", reached=median <= 5)
    double = [bench.trial(two_terms, 32.0, seed * 200_000 + i) for i in _progress(range(count // 4), "two terms")]
    shown = [t for t in double if t.found.terms]
    right = [any(is_right(t, terms) for terms in formulas(t)) for t in shown]
    _row(f"two terms, d 32: both in the set, {len(shown)} detected", np.mean(right), "(no goal)", reached=True)
    strange = [
        bench.trial(not_expressible, d, seed * 300_000 + i)
        for d in (16.0, 32.0)
        for i in _progress(range(count // 4), "not expressible")
    ]
    _strange_rows(strange)


def whole(count: int, seed: int) -> None:
    """Laws through the whole diagnosis, its library first."""
    for d in STRENGTHS[1:]:
        outcomes: dict[str, int] = defaultdict(int)
        for i in _progress(range(count), f"whole d {d:g}"):
            made = campaign(in_grammar, d, seed * 600_000 + i, UNITS)
            assert made.law is not None
            outcomes[_outcome(diagnose(recipe(), made.table, Model(), null_of), made.law)] += 1
        shown = max(count - outcomes["none"], 1)
        for what, goal, least in (("right", ">= .93", 0.93), ("named", "<= .03", None)):
            share = outcomes[what] / shown
            met = share >= least if least is not None else share <= 0.03
            _row(f"whole diagnosis, d {d:g}: {what}", share, goal, met, str(dict(outcomes)))


def _outcome(found: Diagnosis, law: Law) -> str:
    """What became of a law: none, named, causes beside the formula, another formula, or right."""
    if found.verdict in ("none", "named") or found.hypotheses is None:
        return found.verdict
    if found.causes:
        return "causes beside"
    fits = [(t.found.fit, *t.found.equivalent) for t in found.hypotheses.terms]
    held = [set(law.families) & {f.term.family for f in some} for some in fits]
    return "right" if len(fits) == len(law.families) and all(held) else "another formula"


def _single_rows(d: float, trials: Sequence[Trial]) -> None:
    goal, gain_goal = GOALS[d]
    shown = [t for t in trials if t.found.terms]
    right = [is_right(t, [x.fit.term for x in t.found.terms[:1]]) for t in shown]
    _row(f"right family given detection, d {d:g} ({len(shown)} of {len(trials)})", np.mean(right), f">= {goal}",
         float(np.mean(right)) >= goal, _spread(right))  # fmt: skip
    near = [cosine(t, [x.fit.term for x in t.found.terms[:1]]) > 0.95 for t in shown]
    _row(f"|cos| > .95 to the truth, d {d:g}", np.mean(near), "(no goal)", reached=True, more=_spread(near))
    sets = [list(formulas(t)) for t in shown]
    covers = [any(is_right(t, terms) for terms in some) for t, some in zip(shown, sets, strict=True)]
    size = float(np.median([len(some) for some in sets]))
    _row(f"set covers the truth, d {d:g}", np.mean(covers), ">= .93", float(np.mean(covers)) >= 0.93, _spread(covers))
    _row(f"median size of the set, d {d:g}", size, "<= 2", size <= 2)
    ratio = np.array([gain_ratio(t) for t in shown])
    _row(f"held-out gain over that of the true law, d {d:g}", np.median(ratio), f">= {gain_goal}",
         float(np.median(ratio)) >= gain_goal, f"mean {ratio.mean():.3f}")  # fmt: skip
    _row(f"negative held-out gain, d {d:g}", np.mean(ratio < 0), "<= .01", float(np.mean(ratio < 0)) <= 0.01)
    wrong = [
        (t.law.name, t.found.terms[0].fit.term.family) for t, ok in zip(shown, right, strict=True) if not ok and t.law
    ]
    for name, family in wrong[:12]:
        print(f"      {name} -> {'·'.join(family)}")


def _strange_rows(trials: Sequence[Trial]) -> None:
    certain = [t for t in trials if t.found.terms and t.found.quiet]
    # A formula that follows the law as closely as these data can show is no invention.
    invented = [
        t for t in certain if t.d * np.sqrt(max(0.0, 1 - cosine(t, [x.fit.term for x in t.found.terms]) ** 2)) > 3.3
    ]
    honest = 1 - len(certain) / len(trials)
    kinds: dict[str, int] = defaultdict(int)
    for t in certain:
        assert t.law is not None
        kinds[t.law.name] += 1
    _row("not expressible: no formula, or incomplete", honest, ">= .90", honest >= 0.9, str(dict(kinds)))
    share = len(invented) / len(trials)
    _row("not expressible: a formula with certainty that is wrong", share, "<= .02", share <= 0.02)


def _missed(t: Trial) -> float:
    """Length of what the formula cannot follow of the law, in white data."""
    return t.d * float(np.sqrt(max(0.0, 1 - cosine(t, [x.fit.term for x in t.found.terms]) ** 2)))


def nulls(bench: Bench, count: int, seed: int) -> None:
    """Nothing is in the data: by the scan alone, many; through the whole search, some."""
    first = bench.trial(None, 0.0, seed)
    p, fitted = first.problem, first.problem.fit()
    scans = [scan_of(x, p.view, scanned_units(p, MOST_SCANNED_UNITS), fitted.floor) for x in libraries(p.view)]
    assert bench.threshold is not None
    largest = np.concatenate(
        [chance.largest_scores(p, fitted, scans, 1000 * seed + i) for i in range(-(-count // chance.NULL_SETS))]
    )
    share = float(np.mean(largest > bench.threshold))
    _row(f"false alarms of the scan, {len(largest)} nulls", share, "<= .015", share <= 0.015)
    whole = max(20, count // 20)
    trials = [bench.trial(None, 0.0, seed * 400_000 + i) for i in _progress(range(whole), "nulls")]
    found = [bool(t.found.terms) for t in trials]
    _row(f"false alarms of the whole search, {whole} nulls", np.mean(found), "<= .015", np.mean(found) <= 0.015,
         _spread(found))  # fmt: skip


def rivals(bench: Bench, count: int, seed: int) -> None:
    """Symbolic regression on the same residuals: told the axis that the law acts on, and all covariates."""
    import discovery_rivals

    ours: dict[float, list[bool]] = defaultdict(list)
    theirs: dict[tuple[str, float], list[bool]] = defaultdict(list)
    makers = list(discovery_rivals.available())
    for d in (16.0, 32.0):
        for i in _progress(range(count), f"rivals d {d:g}"):
            t = bench.trial(in_grammar, d, seed * 500_000 + i)
            ours[d].append(cosine(t, [x.fit.term for x in t.found.terms[:1]]) > 0.95)
            for name, fit in makers:
                theirs[name, d].append(_rival_cosine(t, fit) > 0.95)
    for d, shares in ours.items():
        best = max((float(np.mean(v)) for (_, at), v in theirs.items() if at == d), default=0.0)
        own = float(np.mean(shares))
        for (name, at), v in theirs.items():
            if at == d:
                print(f"      {name}: {np.mean(v):.2f} ({_spread(v)})")
        what, goal = f"|cos| > .95 to the truth, d {d:g}, against the best rival", f">= {best:.2f} + .10"
        _row(what, own, goal, own >= best + 0.1, _spread(shares))


def library(bench: Bench, seed: int) -> None:
    """Each cause of the library, found again by a station that knows none."""
    first = bench.trial(None, 0.0, seed)
    null = bench.alarm_of(first.problem)
    right = []
    for name in rediscovery.FORMS:
        found = rediscovery.rediscover(name, 11 + seed, null, bench.threshold_of)
        right.append(rediscovery.is_rediscovered(name, found))
        if not right[-1]:
            print(f"      {name} -> {[t.fit.term.family for t in found.terms]}")
    share = float(np.mean(right))
    _row(f"{len(right)} library causes at their usual size, found again", share, ">= .90", share >= 0.9, _spread(right))


def xsens(folder: Path) -> None:
    """A real sensor turned by hand: the matrix must be found where the simulation has none."""
    from tests.integration import test_real_recordings as recordings

    with TemporaryDirectory() as scratch, redirect_stdout(StringIO()):
        here = Path(scratch)
        recording = str(folder / "xsens_mti_tumble" / "xsens_acc.mat")
        scale = repr(1 / recordings.XSENS_SCALE / recordings.XSENS_G)
        (here / "by-hand.yaml").write_text(recordings.BY_HAND, encoding="utf-8")
        samples = here / "xsens.parquet"
        zero = str(recordings.XSENS_ZERO)
        recordings.station("segment", recording, "--zero", zero, "--scale", scale, "--out", str(samples))
        kind, made = load_recipe(str(here / "by-hand.yaml")), read_samples(samples)
    whole = inspect(kind, recut(kind, made.used()).table).table
    problem = initial_problem(reduce_samples(kind, whole), FloorAllowance.of(kind, Model()))
    fitted = problem.fit()
    now = marginalise_walks(problem, score_bank(problem, build_banks(problem.view, ()), fitted.floor))
    found = discover(problem, null_of(problem, fitted, now), (), 1)
    for t in found.terms:
        print(f"      {formula_text(t.fit.term)}")
    left = 1e3 * remaining_rms(found.problem)
    _row(f"Xsens, {1e3 * remaining_rms(problem):.3g} mg with offset and gains, with the formula, mg", left, "<= .11",
         left <= 0.11)  # fmt: skip


def _rival_cosine(t: Trial, fit: Callable[[Floats, Floats], Floats]) -> float:
    view, scene = t.problem.view, t.problem.view.scene
    assert t.law is not None
    y = (view.reduced.mean - view.simulated()[0])[:, t.law.axis]
    a = scene.visits
    felt = np.einsum("vji,vj->vi", np.einsum("vij,vjk->vik", a.nest_R, a.seat_R), a.stimulus)
    step = np.where(a.previous[:, None] >= 0, felt[a.previous] - felt, 0.0)
    covariates = [scene.require(n) for n in ("temperature_degC", "temperature_rate", "motor")]
    X = np.column_stack([felt, step, scene.time_s, *covariates])
    predicted = np.zeros((len(y), 3))
    predicted[:, t.law.axis] = fit((X - X.mean(0)) / X.std(0), y / y.std())
    white = t.space.project(view.rows(predicted[..., None], None))[..., 0].ravel()
    on_axis = float(np.linalg.norm(white) * np.linalg.norm(t.truth))
    return abs(float(white @ t.truth)) / on_axis if on_axis > 0 else 0.0


def _progress(items: Sequence[int] | range, what: str) -> Iterator[int]:
    for n, item in enumerate(items):
        if sys.stderr.isatty() and n % 10 == 0:
            print(f"\r{what}: {n} of {len(items)}", end="", file=sys.stderr)
        yield item


def _spread(hits: Sequence[bool]) -> str:
    """± one standard error of a share."""
    n, p = max(len(hits), 1), float(np.mean(hits)) if len(hits) else 0.0
    return f"± {np.sqrt(p * (1 - p) / n):.3f}, n {n}"


def _row(what: str, figure: Any, goal: str, reached: Any, more: str = "") -> None:
    print(f"  {what:<64} {float(figure):>7.3f}  goal {goal:<12} {'met' if reached else 'MISSED':<7}{more}", flush=True)
    figures.keep(19, what, f"{float(figure):.3f} {more}".strip(), "", goal, bool(reached))


def main() -> None:
    """Prints every row."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--laws", type=int, default=200)
    parser.add_argument("--nulls", type=int, default=2000)
    parser.add_argument("--rivals", type=int, default=6)
    parser.add_argument("--seed", type=int, default=1)
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("STATION_REFERENCE_DATA", beside)))
    parser.add_argument("--whole", type=int, default=30, help="laws of a strength through the whole diagnosis")
    parts = ("laws", "whole", "nulls", "rivals", "library", "xsens")
    parser.add_argument("--only", nargs="+", choices=parts, default=parts)
    asked = parser.parse_args()
    print(f"formulas proposed for laws outside the library, seed {asked.seed}")
    bench = Bench()
    bench.trial(None, 0.0, asked.seed)
    print(f"  score by chance: {bench.threshold:.2f} nats")
    if "nulls" in asked.only:
        nulls(bench, asked.nulls, asked.seed)
    if "laws" in asked.only:
        laws(bench, asked.laws, asked.seed)
    if "whole" in asked.only:
        whole(asked.whole, asked.seed)
    if "library" in asked.only:
        library(bench, asked.seed)
    if "xsens" in asked.only:
        xsens(asked.data)
    if "rivals" in asked.only:
        rivals(bench, asked.rivals, asked.seed)


if __name__ == "__main__":
    main()
