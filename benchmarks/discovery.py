"""Formulas of laws that nobody wrote down: right family, sets, false alarms, held-out gain, rivals, time.

    python benchmarks/discovery.py [--laws 200] [--nulls 2000] [--whole 30] [--rivals 6] [--only laws nulls library]
    python benchmarks/discovery.py --only nulls --first 500 --nulls 500 --out nulls.jsonl     one portion of many
    python benchmarks/discovery.py --sum *.jsonl                                              their table

Laws are made by `discovery_laws.py`, which shares no line with the grammar: in the grammar with constants off every
grid, of two terms, not expressible, and none. Four units go through tilt-24 three times; d is the length of what a law
leaves in white means of the visits. Readings go through the station's own reduction and calibration; the formula is
looked for in what that leaves. A law counts as detected where a formula is proposed. `library`: each cause of the
library that moves means, at its usual size, by a station that knows none. `xsens`: a real recording (--data DIR) whose
simulation has nothing but offset and gains. `whole`: through the whole diagnosis, where causes of the library may
imitate a law: a verdict is right that names none and holds the law in its set. `rivals`: symbolic regression on the
same residuals, told the axis that the law acts on, and all covariates.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import redirect_stdout
from functools import partial
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import discovery_rivals
import numpy as np
from diagnosis_rows.figures import Figure, at_most
from discovery_figures import GOALS, print_table
from discovery_laws import Law, campaign, in_grammar, not_expressible, two_terms
from discovery_trials import UNITS, Bench, Outcome, Trial, cosine, outcome_line, outcome_of, read_outcomes

from station.config.recipes import load_recipe
from station.diagnosis.data.faults import inspect
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.data.stays import recut
from station.diagnosis.discovery.discover import discover
from station.diagnosis.results.diagnose import Diagnosis, diagnose
from station.diagnosis.results.remaining_residual import remaining_rms
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.domain.core.types import Floats
from station.model.formula.text import formula_text
from station.model.model_file import Model
from station.wiring.sample_files import read_samples
from tests.blind import rediscovery
from tests.blind.inspection import null_of
from tests.blind.recipes import recipe

#: The probability from which a cause is named for certain.
CERTAIN = 0.9
#: The strengths at which there is something to measure of what no formula expresses, the whole diagnosis, and rivals.
STRONG = (16.0, 32.0)


class Portion(NamedTuple):
    """Campaigns of a part that are run: their numbers, strengths and seed."""

    numbers: range
    strengths: tuple[float, ...]
    seed: int

    def seeds(self, thousands: int) -> Iterator[int]:
        """A seed of its own for each campaign."""
        return (self.seed * 1000 * thousands + i for i in self.numbers)

    @property
    def strong(self) -> Iterator[float]:
        """The strengths wanted that are strong."""
        return (d for d in self.strengths if d in STRONG)


def _trials(
    part: str,
    make: Callable[..., Law] | None,
    strengths: Iterable[float],
    bench: Bench,
    seeds: Callable[[], Iterator[int]],
) -> Iterator[Outcome]:
    """Campaigns of one kind of law, at each strength with the same seeds."""
    for d in strengths:
        for at in seeds():
            yield outcome_of(part, at, bench.trial(make, d, at))


def laws(bench: Bench, portion: Portion) -> Iterator[Outcome]:
    """One term in the grammar, at every strength."""
    return _trials("laws", in_grammar, portion.strengths, bench, partial(portion.seeds, 100))


def double(bench: Bench, portion: Portion) -> Iterator[Outcome]:
    """Two terms of about one strength."""
    return _trials("two terms", two_terms, STRONG[-1:], bench, partial(portion.seeds, 200))


def strange(bench: Bench, portion: Portion) -> Iterator[Outcome]:
    """What no three terms of the grammar are."""
    return _trials("not expressible", not_expressible, portion.strong, bench, partial(portion.seeds, 300))


def nulls(bench: Bench, portion: Portion) -> Iterator[Outcome]:
    """Nothing is in the data."""
    return _trials("nulls", None, (0.0,), bench, partial(portion.seeds, 400))


def whole(_bench: Bench, portion: Portion) -> Iterator[Outcome]:
    """Laws through the whole diagnosis, its library first."""
    for d in portion.strong:
        for at in portion.seeds(600):
            made = campaign(in_grammar, d, at, UNITS)
            assert made.law is not None
            start = time.process_time()
            found = diagnose(recipe(), made.table, Model(), null_of)
            seconds = time.process_time() - start
            names = tuple(cause.finding.name for cause in found.causes)
            yield Outcome("whole", d, at, made.law.name, names, verdict=_verdict(found, made.law), seconds=seconds)


def _verdict(found: Diagnosis, law: Law) -> str:
    """What became of a law: none, named for certain or as likely, causes beside the formula, another formula, right."""
    if found.verdict in ("none", "named") or found.hypotheses is None:
        unsure = found.verdict == "named" and any(c.finding.set_probability < CERTAIN for c in found.causes)
        return "named as likely" if unsure else found.verdict
    if found.causes:
        return "causes beside"
    fits = [(t.found.fit, *t.found.equivalent) for t in found.hypotheses.terms]
    held = [set(law.families) & {f.term.family for f in some} for some in fits]
    return "right" if len(fits) == len(law.families) and all(held) else "another formula"


def library(bench: Bench, portion: Portion) -> Iterator[Outcome]:
    """Each cause of the library, found again by a station that knows none."""
    for name in list(rediscovery.FORMS)[portion.numbers.start : portion.numbers.stop]:
        found = rediscovery.rediscover(name, 11 + portion.seed, bench.threshold_of)
        families = tuple("·".join(t.fit.term.family) for t in found.terms)
        yield Outcome("library", 0.0, portion.seed, name, families, right=rediscovery.is_rediscovered(name, found))


def rivals(bench: Bench, portion: Portion) -> Iterator[Outcome]:
    """Symbolic regression on the same residuals."""
    makers = list(discovery_rivals.available())
    for d in portion.strong:
        for at in portion.seeds(500):
            t = bench.trial(in_grammar, d, at)
            assert t.law is not None
            own = cosine(t, [x.fit.term for x in t.found.terms[:1]])
            theirs = {name: _rival_cosine(t, fit) for name, fit in makers}
            yield Outcome("rivals", d, at, t.law.name, cosine=own, rivals=theirs)


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


def xsens(folder: Path) -> None:
    """A real sensor turned by hand: the matrix must be found where the simulation has none."""
    from tests.fakes.command import station
    from tests.integration import test_real_recordings as recordings

    with TemporaryDirectory() as scratch, redirect_stdout(StringIO()):
        here = Path(scratch)
        recording = str(folder / "xsens_mti_tumble" / "xsens_acc.mat")
        scale = repr(1 / recordings.XSENS_SCALE / recordings.XSENS_G)
        (here / "by-hand.yaml").write_text(recordings.BY_HAND, encoding="utf-8")
        samples = here / "xsens.parquet"
        zero = str(recordings.XSENS_ZERO)
        station("segment", recording, "--zero", zero, "--scale", scale, "--out", str(samples))
        kind, made = load_recipe(str(here / "by-hand.yaml")), read_samples(samples)
    used = inspect(kind, recut(kind, made.used()).table).table
    problem = initial_problem(reduce_samples(kind, used), FloorAllowance.of(kind, Model()))
    found = discover(problem, None, 1)
    for t in found.terms:
        print(f"      {formula_text(t.fit.term)}")
    left = 1e3 * remaining_rms(found.problem)
    before = f"{1e3 * remaining_rms(problem):.3g} mg before"
    goal, met = at_most(left, 0.11)
    print(
        Figure("Xsens with offset and gains alone, with the formula, mg", left, left, left, 1, goal, met, before).line()
    )


#: Each part: how its campaigns are made, and how many as a share of the option that counts them.
PARTS: dict[str, tuple[Callable[[Bench, Portion], Iterator[Outcome]], str, int]] = {
    "nulls": (nulls, "nulls", 1),
    "laws": (laws, "laws", 1),
    "two-terms": (double, "laws", 4),
    "not-expressible": (strange, "laws", 4),
    "whole": (whole, "whole", 1),
    "library": (library, "library", 1),
    "rivals": (rivals, "rivals", 1),
}


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--laws", type=int, default=200, help="of one term, of each strength; a quarter of the others")
    parser.add_argument("--nulls", type=int, default=2000)
    parser.add_argument("--rivals", type=int, default=6)
    parser.add_argument("--whole", type=int, default=30, help="laws of a strength through the whole diagnosis")
    parser.add_argument("--library", type=int, default=len(rediscovery.FORMS), help="causes that are found again")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--strengths", type=float, nargs="+", default=(*GOALS,), choices=(*GOALS,), help="d of the laws"
    )
    parser.add_argument("--first", type=int, default=0, help="number of the first campaign of each part, for portions")
    parser.add_argument("--only", nargs="+", choices=(*PARTS, "xsens"), default=(*PARTS, "xsens"))
    parser.add_argument(
        "--out", type=Path, help="add the outcome of each campaign to this file, one JSON object a line"
    )
    parser.add_argument("--sum", type=Path, nargs="+", help="print the table of such files, and run nothing")
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("STATION_REFERENCE_DATA", beside)))
    return parser.parse_args()


def _outcomes(options: argparse.Namespace) -> Iterator[Outcome]:
    """The outcomes of all parts, one after the other."""
    bench = Bench()
    bench.trial(None, 0.0, options.seed)
    print(f"score by chance: {bench.threshold:.2f} nats")
    for part in (p for p in PARTS if p in options.only):
        run, counted, divisor = PARTS[part]
        count = -(-getattr(options, counted) // divisor)
        portion = Portion(range(options.first, options.first + count), tuple(options.strengths), options.seed)
        for n, outcome in enumerate(run(bench, portion)):
            yield outcome
            if sys.stderr.isatty() and n % 10 == 0:
                print(f"\r{part}: {n} ", end="", file=sys.stderr)


def main() -> None:
    """Runs the parts, or sums up what ran before."""
    options = _options()
    if options.sum:
        print_table(read_outcomes(options.sum))
        return
    print(f"formulas proposed for laws outside the library, seed {options.seed}")
    made: list[Outcome] = []
    for outcome in _outcomes(options):
        made.append(outcome)
        if options.out:
            with options.out.open("a", encoding="utf-8") as file:
                file.write(outcome_line(outcome))
    print_table(made)
    if "xsens" in options.only:
        xsens(options.data)


if __name__ == "__main__":
    main()
