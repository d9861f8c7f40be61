"""Adaptive dwell (`until_std`): time against a fixed dwell and against the bound of known noise, and honest intervals.

    python benchmarks/dwell.py [--units 1000] [--case white] [--earlier 50] [--nests 1] [--seed 1]

Units whose noise density differs (ln-normal, 25 %) go stop by stop through the rule of the run; every decision is
the run's own code, for many fixtures at once. They know what --earlier units of the kind (others, each of which knew
nothing) told of their noise: as many as a run asks the log for; --earlier 0 is the first load of a new recipe.
The fixed dwell is the shortest that brings the worst unit of the population to the wanted uncertainty; the bound is
the best allocation for each fixture's true noise, known beforehand. Coverage: true coefficients inside ± 1.96 standard
deviations of the calibration that the same readings come to; for the stated goal run it with --units 10000, which
takes two to five minutes a case. Noise is white, first-order (phi) or white with 1/f, with the sheet's density at low
frequencies.

Kinds that the rule was not made on, by --case only: mixed (each unit's phi another), 1/f, outliers (a tenth with 3 to
10 times the noise), alike (3 % spread), apart (50 %), stranger (phi 0.8 where all earlier units were white).
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from figures import keep
from numpy.typing import NDArray
from scipy.signal import lfilter

from station.domain.core.types import Floats, Labels, SampleTable
from station.domain.evaluation import pipeline
from station.domain.noise import noise_document
from station.domain.noise.noise_prior import MAX_UNITS, NoisePrior, learn_prior
from station.domain.noise.running_noise import (
    DwellNoise,
    NoiseCurve,
    dwell_noise,
    family_length,
    likelihoods,
    noise_curve,
)
from station.domain.planning import adaptive_dwell, nominal_visits
from station.domain.planning.adaptive_dwell import AccuracyTarget, DwellProgress
from station.domain.recipe.recipe import Recipe
from tests.fakes import tumble

Whole = NDArray[np.int64]
#: The noise (f, nests, n, 3) of a stop, and how many (f) of its readings count.
Stop = tuple[Floats, Whole]
SPREAD, DENSITY, WANTED, LONGEST_S = 0.25, 1e-4, 5e-5, 8.0
FIXED_GOAL, BOUND_GOAL, COVERED = 0.60, 1.10, (0.94, 0.96)
#: Readings of one stop that are held at a time, for the longest dwell.
HELD = 4_000_000
BURN = 200


@dataclass(frozen=True)
class Shape:
    """First-order noises that add up: their shares of the variance, and their phi."""

    share: tuple[float, ...]
    phi: tuple[float, ...]

    def long_run(self) -> float:
        """n · variance of the mean of n readings of unit variance, n without end."""
        return sum(a * (1 + p) / (1 - p) for a, p in zip(self.share, self.phi, strict=True))

    def of_long_run(self, count: Floats) -> Floats:
        """The same for n = count readings, over that."""
        short = [a * 2 * p * (1 - p**count) / (count * (1 - p) ** 2) for a, p in zip(self.share, self.phi, strict=True)]
        return np.asarray(1 - np.sum(short, axis=0) / self.long_run())

    def drawn(self, count: int, many: tuple[int, ...], rng: np.random.Generator) -> Floats:
        """Noise (..., count, 3) of unit long-run variance · readings."""
        x = np.zeros((*many, count, 3), np.float32)
        for a, p in zip(self.share, self.phi, strict=True):
            e = rng.standard_normal((*many, count + BURN * (p > 0), 3), dtype=np.float32)
            x += np.sqrt(a) * (lfilter([np.sqrt(1 - p**2)], [1, -p], e, axis=-2)[..., BURN:, :] if p else e)
        return np.asarray(x / np.sqrt(self.long_run()))


def first_order(phi: float) -> Shape:
    """First-order noise."""
    return Shape((1.0,), (phi,))


#: Correlation times of half a reading to 64, evenly in their logarithm, are 1/f over two decades.
ONE_OVER_F = Shape((0.6, *[0.05] * 8), (0.0, *np.exp(-1 / 2.0 ** np.arange(-1, 7))))


@dataclass(frozen=True)
class Case:
    """A kind of units and who measures them: shapes of noise, one for each unit, recipe, sample rate, spread of ln
    density, share of outliers; earlier: shapes of the units before, where those were another kind."""

    shapes: tuple[Shape, ...]
    method: str = "six-point"
    rate_hz: float = 100.0
    spread: float = SPREAD
    outliers: float = 0.0
    earlier: tuple[Shape, ...] = ()


WHITE = (first_order(0.0),)
CASES = {
    "white": Case(WHITE),
    "0.5": Case((first_order(0.5),)),
    "0.8": Case((first_order(0.8),)),
    "0.9": Case((first_order(0.9),)),
    "18-positions": Case(WHITE, "n-point"),
    "18-positions-1kHz": Case(WHITE, "n-point", 1000.0),
}
OTHERS = {
    "mixed": Case(tuple(first_order(p) for p in (0.0, 0.3, 0.6, 0.8, 0.9))),
    "1/f": Case((ONE_OVER_F,)),
    "outliers": Case(WHITE, outliers=0.1),
    "alike": Case(WHITE, spread=0.03),
    "apart": Case(WHITE, spread=0.5),
    "stranger": Case((first_order(0.8),), earlier=WHITE),
}


@dataclass(frozen=True)
class Units:
    """Fixtures (f) of nests (n). density (f, n), unit/√Hz; shape (f, n): number of each unit's shape in the case."""

    density: Floats
    shape: Whole
    case: Case

    def rows(self, rows: Whole) -> "Units":
        """Some of the fixtures."""
        return Units(self.density[rows], self.shape[rows], self.case)


def units_of(case: Case, many: tuple[int, int], rng: np.random.Generator) -> Units:
    """Units of a kind."""
    outlier = np.where(rng.random(many) < case.outliers, rng.uniform(3, 10, many), 1.0)
    density = DENSITY * np.exp(case.spread * rng.standard_normal(many)) * outlier
    return Units(density, rng.integers(0, len(case.shapes), many), case)


def main() -> None:
    """Prints times and coverage."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=1000, help="a fifth of it at 1 kHz")
    parser.add_argument("--case", choices=list(CASES | OTHERS), action="append")
    parser.add_argument("--nests", type=int, default=1)
    parser.add_argument("--earlier", type=int, default=MAX_UNITS)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    for name in options.case or CASES:
        case = (CASES | OTHERS)[name]
        began = time.process_time()
        shown(name, case, options.units // (5 if case.rate_hz > 500 else 1), options)
        print(f"  {time.process_time() - began:.0f} s of processor time\n", flush=True)


def shown(name: str, case: Case, units: int, options: argparse.Namespace) -> None:
    """One case."""
    recipe = tumble.recipe(
        case.method,
        device={"rate_hz": case.rate_hz, "noise_density": DENSITY},
        dwell={"until_std": WANTED, "min_s": 0.2, "max_s": LONGEST_S},
    )
    aim = adaptive_dwell.accuracy_target(recipe)
    rng = np.random.default_rng(options.seed)
    f = units // options.nests
    prior = known(aim, case, options)
    everybody = units_of(case, (f, options.nests), rng)
    spent, inside, ratio = [], [], []
    for rows in np.array_split(np.arange(f), max(round(units * case.rate_hz * LONGEST_S / HELD), 1)):
        line = Line(aim, everybody.rows(rows), rng, prior)
        dwell_s, readings = line.run()
        spent.append(dwell_s.sum(axis=1))
        for hit, share in line.calibrated(recipe, readings):
            inside.append(hit)
            ratio.append(share)
    spent_s, ratios = np.concatenate(spent), np.array(ratio)
    bound_s = bounds(aim, everybody)
    worst = np.flatnonzero(everybody.density.max(axis=1) == everybody.density.max())
    fixed_s = float(bounds(aim, everybody.rows(worst)).max())
    covered, se = np.mean(inside), np.std(np.mean(inside, axis=1)) / np.sqrt(len(inside))
    of_fixed, of_bound = spent_s.mean() / fixed_s, spent_s / bound_s
    mean_of_bound, error = spent_s.sum() / bound_s.sum(), of_bound.std() / np.sqrt(f)
    good = of_fixed <= FIXED_GOAL, mean_of_bound <= BOUND_GOAL, COVERED[0] <= covered <= COVERED[1]
    words = [" MISSED," * (not reached) or "," for reached in good]
    who = f"{f} fixtures of {options.nests} after {options.earlier} units"
    print(f"{name}: {case.method}, {case.rate_hz:g} Hz, {who}, until_std {WANTED:g} g")
    print(f"  dwell {spent_s.mean():.2f} s a fixture (5–95 %: {quantiles(spent_s)}), fixed {fixed_s:.2f} s")
    print(f"  of the fixed dwell {of_fixed:.3f}{words[0]} goal ≤ {FIXED_GOAL}")
    print(f"  of the bound {mean_of_bound:.3f} ± {error:.3f} (5–95 %: {quantiles(of_bound)}){words[1]} ≤ {BOUND_GOAL}")
    print(f"  coverage of 95 % {covered:.4f} ± {se:.4f}{words[2]} goal .94–.96")
    quiet, loud = tenths(everybody.density.ravel(), np.mean(inside, axis=1))
    print(f"    of the quietest tenth of the units {quiet:.4f}, of the noisiest {loud:.4f}")
    share = np.quantile(ratios, 0.95)
    print(f"  worst coefficient told over wanted: median {np.median(ratios):.3f}, 95 % of units ≤ {share:.3f}")
    what = f"adaptive dwell, {name} ({case.method}, {case.rate_hz:g} Hz), after {options.earlier} units"
    figure = (
        f"{of_fixed:.2f} of fixed; {mean_of_bound:.3f} ± {error:.3f} of the bound; {covered:.4f} ± {se:.4f} covered"
    )
    keep(
        3, what, f"{figure}, {f * options.nests} units", "fixed dwell; known noise", "≤ .60; ≤ 1.10; .94–.96", all(good)
    )


def quantiles(x: Floats) -> str:
    """5 and 95 %."""
    return f"{np.quantile(x, 0.05):.2f}–{np.quantile(x, 0.95):.2f}"


def tenths(density: Floats, inside: Floats) -> tuple[float, float]:
    """Coverage of the quietest and of the noisiest tenth of the units."""
    by_density = inside[np.argsort(density, kind="stable")]
    tenth = max(len(inside) // 10, 1)
    return float(by_density[:tenth].mean()), float(by_density[-tenth:].mean())


def known(aim: AccuracyTarget, case: Case, options: argparse.Namespace) -> NoisePrior | None:
    """What units measured before have told, of whom each knew nothing."""
    if not options.earlier:
        return None
    rng = np.random.default_rng(options.seed + 1000)
    before = replace(case, shapes=case.earlier or case.shapes)
    line = Line(aim, units_of(before, (options.earlier, 1), rng), rng, None)
    return line.shown_of_kind(line.run()[1])


def bounds(aim: AccuracyTarget, units: Units) -> Floats:
    """Least total dwell (f), s, where each unit's noise is known."""
    count = np.unique(
        np.rint(np.geomspace(aim.shortest_s * aim.rate_hz, aim.longest_s * aim.rate_hz, 12)).astype(int)
    ).astype(float)
    by_shape = np.array([s.of_long_run(count) for s in units.case.shapes])
    worst = (by_shape[units.shape] * (units.density**2 / 2 * aim.rate_hz)[..., None]).max(axis=1)
    f = len(worst)
    known = NoiseCurve(count, np.tile(worst[:, None], (1, 3, 1)), np.full((f, 3, len(count)), 1e9), np.ones((f, 0, 3)))
    guess = np.full((f, len(aim)), 1.0)
    so_far = DwellProgress(known, np.zeros_like(guess), np.zeros(0, np.intp), np.ones(f))
    return np.asarray(adaptive_dwell.plan_dwells(aim, so_far, guess, adaptive_dwell.ROUNDS).dwell_s.sum(axis=1))


class Line:
    """Fixtures (f) of nests, at once; prior: what is known of their noise."""

    def __init__(self, aim: AccuracyTarget, units: Units, rng: np.random.Generator, prior: NoisePrior | None) -> None:
        self.aim, self.units, self.rng, self.prior = aim, units, rng, prior
        self.density = units.density
        self.theta = tumble.units(rng, self.density.size)
        self.true = nominal_visits.truths(aim.recipe)
        self.longest = max(round(aim.longest_s * aim.rate_hz), 2)
        self.shown: dict[tuple[int, int, int], DwellNoise] = {}

    def run(self) -> tuple[Floats, list[Stop]]:
        """Dwells (f, v), s, and each stop's noise (f, nests, n, 3) with how many (f) of its readings count."""
        f, v = len(self.density), len(self.aim)
        done_s, readings = np.zeros((f, v)), list[Stop]()
        plan_s = np.tile(adaptive_dwell.initial_dwells_s(self.aim, DENSITY**2 / 2), (f, 1))
        for stop in range(v):
            noise = self.noise()
            lasted_s, plan_s = self.dwell(stop, noise, readings, done_s, plan_s)
            done_s[:, stop] = lasted_s
            count = self.count(lasted_s)
            readings.append((noise[:, :, : count.max()].copy(), count))
        return done_s, readings

    def dwell(
        self, stop: int, noise: Floats, readings: list[Stop], done_s: Floats, plan_s: Floats
    ) -> tuple[Floats, Floats]:
        """One stop of all fixtures: look, plan, and look again, each at its own times."""
        lasted_s = np.full(len(done_s), self.aim.shortest_s)
        going, plan_s = np.arange(len(done_s)), plan_s.copy()
        past = np.array([count for _, count in readings]).reshape(stop, len(done_s))
        while len(going):
            now = self.count(lasted_s)
            reaches = np.array([family_length(n, self.prior) for n in np.max([*past, now], axis=0)])
            for reach in np.unique(reaches[going]).tolist():
                rows = going[reaches[going] == reach]
                curves = self.curves(rows, reach, (noise, now), readings)
                observed_s = done_s[rows].sum(axis=1) + lasted_s[rows]
                so_far = DwellProgress(
                    adaptive_dwell.worst_curve(curves), done_s[rows], np.arange(stop + 1), observed_s
                )
                plan_s[rows] = adaptive_dwell.plan_dwells(self.aim, so_far, plan_s[rows]).dwell_s
            again_s = adaptive_dwell.next_check_s(plan_s[going, stop], lasted_s[going])
            # A reading is whole; the run's clock is not that coarse.
            again_s = np.ceil(again_s * self.aim.rate_hz - 1e-6) / self.aim.rate_hz
            more = (again_s > lasted_s[going]) & (lasted_s[going] < self.aim.longest_s)
            lasted_s[going] = np.where(more, again_s, lasted_s[going])
            going = going[more]
        return lasted_s, plan_s

    def curves(self, rows: Whole, reach: int, present: Stop, readings: list[Stop]) -> list[NoiseCurve]:
        """What every nest of the fixtures `rows` has told; earlier stops are told once for each reach."""
        found = []
        for nest in range(self.density.shape[1]):
            for stop, done in enumerate(readings):
                if (nest, stop, reach) not in self.shown:
                    self.shown[nest, stop, reach] = dwelt_of(done, nest, np.arange(len(self.density)), reach)
            earlier = [some(self.shown[nest, stop, reach], rows) for stop in range(len(readings))]
            found.append(noise_curve([*earlier, dwelt_of(present, nest, rows, reach)], reach, self.prior))
        return found

    def shown_of_kind(self, readings: list[Stop]) -> NoisePrior | None:
        """What the first nests tell of the next units, as the log keeps it."""
        longest = adaptive_dwell.prior_length(self.aim.recipe)
        units = likelihoods([dwelt_of(done, 0, np.arange(len(self.density)), longest) for done in readings], longest)
        return learn_prior(
            noise_document.all_likelihoods({"noise": noise_document.of_likelihood(u)} for u in units), longest
        )

    def count(self, lasted_s: Floats) -> Whole:
        """Readings of dwells."""
        return np.rint(lasted_s * self.aim.rate_hz).astype(int)

    def noise(self) -> Floats:
        """Noise (f, nests, n, 3) of one stop for the longest dwell."""
        x = np.empty((*self.density.shape, self.longest, 3))
        for number, shape in enumerate(self.units.case.shapes):
            own = self.units.shape == number
            x[own] = shape.drawn(self.longest, (int(own.sum()),), self.rng)
        # A sheet's density is that at low frequencies, where a mean lives.
        x *= (self.density * np.sqrt(self.aim.rate_hz / 2))[..., None, None]
        return x

    def calibrated(self, recipe: Recipe, readings: list[Stop]) -> Iterator[tuple[NDArray[np.bool_], float]]:
        """Of every unit: which (12) coefficients lie in their intervals, and the worst noise over the wanted."""
        table = self.table(readings)
        for unit, found in enumerate(pipeline.calibrate(recipe, table, tumble.TODAY, prior=self.prior)):
            assert found.budget is not None
            off = np.abs(tumble.coefficients(found) - self.theta[unit])
            shown = found.budget.std("noise") / np.where(np.isfinite(self.aim.std), self.aim.std, np.inf)
            yield off <= 1.96 * found.budget.std(), float(shown.max())

    def table(self, readings: list[Stop]) -> SampleTable:
        """All readings in the order of unit, stop and time."""
        f, nests = self.density.shape
        mean = tumble.readings(self.theta, self.true).reshape(f, nests, len(self.aim), 3)
        rows = [(i, k, v) for i in range(f) for k in range(nests) for v in range(len(self.aim))]
        each = np.array([readings[v][1][i] for i, _, v in rows])
        reading = np.concatenate([mean[i, k, v] + readings[v][0][i, k, : readings[v][1][i]] for i, k, v in rows])
        names = nominal_visits.names(self.aim.recipe)[0]
        number = np.repeat(np.array(rows), each, axis=0).astype(np.int32)
        return SampleTable(
            unit=Labels(tuple(f"SN{i:05d}" for i in range(f * nests)), number[:, 0] * nests + number[:, 1]),
            run=np.zeros(len(number), np.int32),
            visit=number[:, 2],
            position=Labels(names, number[:, 2]),
            time_s=np.concatenate(
                [v * 30.0 + np.arange(n) / self.aim.rate_hz for (_, _, v), n in zip(rows, each, strict=True)]
            ),
            reading=reading,
        )


def dwelt_of(dwells: Stop, nest: int, rows: Whole, reach: int) -> DwellNoise:
    """What dwells of different length tell; those of one length together."""
    noise, count = dwells
    found = [
        (at, dwell_noise(noise[rows[at], nest, :n], reach))
        for n in np.unique(count[rows])
        for at in [np.flatnonzero(count[rows] == n)]
    ]
    back = np.argsort(np.concatenate([at for at, _ in found]))
    return DwellNoise(*(np.concatenate([getattr(d, name) for _, d in found])[back] for name in DwellNoise.__slots__))


def some(d: DwellNoise, rows: Whole) -> DwellNoise:
    """Some of the units."""
    return DwellNoise(*(getattr(d, name)[rows] for name in DwellNoise.__slots__))


if __name__ == "__main__":
    main()
