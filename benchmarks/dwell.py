"""Adaptive dwell (`until_std`): time against a fixed dwell and against the bound of known noise, and honest intervals.

    python benchmarks/dwell.py [--units 1000] [--case white] [--nests 1] [--seed 1]

Units whose noise density differs (ln-normal, 25 %) go stop by stop through the rule of the run; every decision is
the run's own code, for many fixtures at once. The fixed dwell is the shortest that brings the worst unit of the
population to the wanted uncertainty; the bound is the best allocation for each fixture's true noise, known beforehand.
Coverage: true coefficients inside ± 1.96 standard deviations of the calibration that the same readings come to; for
the stated goal run it with --units 10000, which takes five minutes a case. Noise is white or first-order (phi at
100 Hz) with the sheet's density at low frequencies.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from figures import keep
from numpy.typing import NDArray
from scipy.signal import lfilter

from station.domain import adaptive_dwell, ideal, pipeline
from station.domain.adaptive_dwell import Aim, SoFar
from station.domain.noise_so_far import Curve, Dwelt, curve, dwelt, reach_of
from station.domain.recipe import Recipe
from station.domain.types import Floats, Labels, SampleTable
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
class Case:
    """A kind of noise and who measures it: phi of first-order noise, recipe, sample rate."""

    phi: float
    method: str
    rate_hz: float


CASES = {
    "white": Case(0.0, "six-point", 100.0),
    "0.5": Case(0.5, "six-point", 100.0),
    "0.8": Case(0.8, "six-point", 100.0),
    "0.9": Case(0.9, "six-point", 100.0),
    "18-positions": Case(0.0, "n-point", 100.0),
    "18-positions-1kHz": Case(0.0, "n-point", 1000.0),
}


def main() -> None:
    """Prints times and coverage."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=1000, help="a fifth of it at 1 kHz")
    parser.add_argument("--case", choices=list(CASES), action="append")
    parser.add_argument("--nests", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    for name in options.case or CASES:
        case = CASES[name]
        began = time.process_time()
        told(name, case, options.units // (5 if case.rate_hz > 500 else 1), options)
        print(f"  {time.process_time() - began:.0f} s of processor time\n", flush=True)


def told(name: str, case: Case, units: int, options: argparse.Namespace) -> None:
    """One case."""
    recipe = tumble.recipe(
        case.method,
        device={"rate_hz": case.rate_hz, "noise_density": DENSITY},
        dwell={"until_std": WANTED, "min_s": 0.2, "max_s": LONGEST_S},
    )
    aim = adaptive_dwell.aim(recipe)
    rng = np.random.default_rng(options.seed)
    f = units // options.nests
    density = DENSITY * np.exp(SPREAD * rng.standard_normal((f, options.nests)))
    long_run = density**2 / 2
    spent, inside, ratio = [], [], []
    for rows in np.array_split(np.arange(f), max(round(units * case.rate_hz * LONGEST_S / HELD), 1)):
        line = Line(aim, density[rows], case.phi, rng)
        dwell_s, readings = line.run()
        spent.append(dwell_s.sum(axis=1))
        for hit, share in line.calibrated(recipe, readings):
            inside.append(hit)
            ratio.append(share)
    spent_s, ratios = np.concatenate(spent), np.array(ratio)
    bound_s = bounds(aim, long_run.max(axis=1), case.phi)
    fixed_s = float(bounds(aim, np.array([long_run.max()]), case.phi)[0])
    covered, se = np.mean(inside), np.std(np.mean(inside, axis=1)) / np.sqrt(len(inside))
    of_fixed, of_bound = spent_s.mean() / fixed_s, spent_s / bound_s
    mean_of_bound, error = spent_s.sum() / bound_s.sum(), of_bound.std() / np.sqrt(f)
    good = of_fixed <= FIXED_GOAL, mean_of_bound <= BOUND_GOAL, COVERED[0] <= covered <= COVERED[1]
    words = [" MISSED," * (not reached) or "," for reached in good]
    print(f"{name}: {case.method}, {case.rate_hz:g} Hz, {f} fixtures of {options.nests}, until_std {WANTED:g} g")
    print(f"  dwell {spent_s.mean():.2f} s a fixture (5–95 %: {quantiles(spent_s)}), fixed {fixed_s:.2f} s")
    print(f"  of the fixed dwell {of_fixed:.3f}{words[0]} goal ≤ {FIXED_GOAL}")
    print(f"  of the bound {mean_of_bound:.3f} ± {error:.3f} (5–95 %: {quantiles(of_bound)}){words[1]} ≤ {BOUND_GOAL}")
    print(f"  coverage of 95 % {covered:.4f} ± {se:.4f}{words[2]} goal .94–.96")
    share = np.quantile(ratios, 0.95)
    print(f"  worst coefficient told over wanted: median {np.median(ratios):.3f}, 95 % of units ≤ {share:.3f}")
    what = f"adaptive dwell, {name} ({case.method}, {case.rate_hz:g} Hz)"
    figure = (
        f"{of_fixed:.2f} of fixed; {mean_of_bound:.3f} ± {error:.3f} of the bound; {covered:.4f} ± {se:.4f} covered"
    )
    keep(
        3, what, f"{figure}, {f * options.nests} units", "fixed dwell; known noise", "≤ .60; ≤ 1.10; .94–.96", all(good)
    )


def quantiles(x: Floats) -> str:
    """5 and 95 %."""
    return f"{np.quantile(x, 0.05):.2f}–{np.quantile(x, 0.95):.2f}"


def bounds(aim: Aim, long_run: Floats, phi: float) -> Floats:
    """Least total dwell (f), s, where first-order noise of so much variance · s is known."""
    count = np.unique(
        np.rint(np.geomspace(aim.shortest_s * aim.rate_hz, aim.longest_s * aim.rate_hz, 12)).astype(int)
    ).astype(float)
    shape = 1 - 2 * phi * (1 - phi**count) / (count * (1 - phi**2))
    known = Curve(
        count,
        np.tile((long_run * aim.rate_hz)[:, None, None] * shape, (1, 3, 1)),
        np.full((len(long_run), 3, len(count)), 1e9),
        np.ones((len(long_run), 0, 3)),
    )
    guess = np.full((len(long_run), len(aim)), 1.0)
    so_far = SoFar(known, np.zeros_like(guess), np.zeros(0, np.intp), np.ones(len(long_run)))
    return np.asarray(adaptive_dwell.plan(aim, so_far, guess, adaptive_dwell.ROUNDS).dwell_s.sum(axis=1))


class Line:
    """Fixtures (f) of nests, at once."""

    def __init__(self, aim: Aim, density: Floats, phi: float, rng: np.random.Generator) -> None:
        self.aim, self.phi, self.rng = aim, phi, rng
        self.density = density
        self.theta = tumble.units(rng, density.size)
        self.true = ideal.truths(aim.recipe)
        self.longest = max(round(aim.longest_s * aim.rate_hz), 2)
        self.told: dict[tuple[int, int, int], Dwelt] = {}

    def run(self) -> tuple[Floats, list[Stop]]:
        """Dwells (f, v), s, and each stop's noise (f, nests, n, 3) with how many (f) of its readings count."""
        f, v = len(self.density), len(self.aim)
        done_s, readings = np.zeros((f, v)), list[Stop]()
        plan_s = np.tile(adaptive_dwell.start_s(self.aim, DENSITY**2 / 2), (f, 1))
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
            reaches = np.array([reach_of(n) for n in np.max([*past, now], axis=0)])
            for reach in np.unique(reaches[going]).tolist():
                rows = going[reaches[going] == reach]
                curves = self.curves(rows, reach, (noise, now), readings)
                seen_s = done_s[rows].sum(axis=1) + lasted_s[rows]
                so_far = SoFar(adaptive_dwell.fixture(curves), done_s[rows], np.arange(stop + 1), seen_s)
                plan_s[rows] = adaptive_dwell.plan(self.aim, so_far, plan_s[rows]).dwell_s
            again_s = adaptive_dwell.ask_again_s(plan_s[going, stop], lasted_s[going])
            # A reading is whole; the run's clock is not that coarse.
            again_s = np.ceil(again_s * self.aim.rate_hz - 1e-6) / self.aim.rate_hz
            more = (again_s > lasted_s[going]) & (lasted_s[going] < self.aim.longest_s)
            lasted_s[going] = np.where(more, again_s, lasted_s[going])
            going = going[more]
        return lasted_s, plan_s

    def curves(self, rows: Whole, reach: int, present: Stop, readings: list[Stop]) -> list[Curve]:
        """What every nest of the fixtures `rows` has told; earlier stops are told once for each reach."""
        found = []
        for nest in range(self.density.shape[1]):
            for stop, done in enumerate(readings):
                if (nest, stop, reach) not in self.told:
                    self.told[nest, stop, reach] = dwelt_of(done, nest, np.arange(len(self.density)), reach)
            earlier = [some(self.told[nest, stop, reach], rows) for stop in range(len(readings))]
            found.append(curve([*earlier, dwelt_of(present, nest, rows, reach)], reach))
        return found

    def count(self, lasted_s: Floats) -> Whole:
        """Readings of dwells."""
        return np.rint(lasted_s * self.aim.rate_hz).astype(int)

    def noise(self) -> Floats:
        """Noise (f, nests, n, 3) of one stop for the longest dwell."""
        shape = (*self.density.shape, self.longest + BURN, 3)
        e = self.rng.standard_normal(shape, dtype=np.float32)
        x = lfilter([np.sqrt(1 - self.phi**2)], [1, -self.phi], e, axis=2)[:, :, BURN:] if self.phi else e[:, :, BURN:]
        # A sheet's density is that at low frequencies, where a mean lives.
        root = np.sqrt(self.aim.rate_hz / 2 * (1 - self.phi) / (1 + self.phi))
        return np.asarray(x * (self.density * root)[..., None, None])

    def calibrated(self, recipe: Recipe, readings: list[Stop]) -> Iterator[tuple[NDArray[np.bool_], float]]:
        """Of every unit: which (12) coefficients lie in their intervals, and the worst noise over the wanted."""
        table = self.table(readings)
        for unit, found in enumerate(pipeline.calibrate(recipe, table, tumble.TODAY)):
            assert found.budget is not None
            off = np.abs(tumble.coefficients(found) - self.theta[unit])
            told = found.budget.std("noise") / np.where(np.isfinite(self.aim.std), self.aim.std, np.inf)
            yield off <= 1.96 * found.budget.std(), float(told.max())

    def table(self, readings: list[Stop]) -> SampleTable:
        """All readings in the order of unit, stop and time."""
        f, nests = self.density.shape
        mean = tumble.readings(self.theta, self.true).reshape(f, nests, len(self.aim), 3)
        rows = [(i, k, v) for i in range(f) for k in range(nests) for v in range(len(self.aim))]
        each = np.array([readings[v][1][i] for i, _, v in rows])
        reading = np.concatenate([mean[i, k, v] + readings[v][0][i, k, : readings[v][1][i]] for i, k, v in rows])
        names = ideal.names(self.aim.recipe)[0]
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


def dwelt_of(dwells: Stop, nest: int, rows: Whole, reach: int) -> Dwelt:
    """What dwells of different length tell; those of one length together."""
    noise, count = dwells
    found = [
        (at, dwelt(noise[rows[at], nest, :n], reach))
        for n in np.unique(count[rows])
        for at in [np.flatnonzero(count[rows] == n)]
    ]
    back = np.argsort(np.concatenate([at for at, _ in found]))
    return Dwelt(*(np.concatenate([getattr(d, name) for _, d in found])[back] for name in Dwelt.__slots__))


def some(d: Dwelt, rows: Whole) -> Dwelt:
    """Some of the units."""
    return Dwelt(*(getattr(d, name)[rows] for name in Dwelt.__slots__))


if __name__ == "__main__":
    main()
