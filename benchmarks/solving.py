"""Calibrations solved a second, covariance included, in bulk and one at a time, against SciPy and imucal.

    python benchmarks/solving.py [--units 4096] [--runs 5]

24 positions, 12 coefficients with their covariance, from position means. The bulk solver is that of backtest, in
portions of the same size; it tests every unit for stops that do not fit and for scatter, and its answers for many
units are bit for bit those for one. Peers, one unit a call as they are made: scipy.optimize.least_squares on the same
24 positions (12 parameters, its Jacobian, and the covariance from it) started at a perfect sensor; imucal's
FerrarisCalibration on six faces, which is all it knows: closed formulas for the same 12 coefficients, no covariance,
no tests. Its call wants turns of a gyroscope as well and solves them too, here of one sample each; against that the
bulk solver's rate on six faces (method six-point, with covariance) stands beside.
"""

import argparse
import statistics
import time
from collections.abc import Callable, Iterator
from importlib.metadata import version

import figures
import numpy as np
from scipy.optimize import least_squares

from station.domain.core.types import Floats
from station.domain.methods import contributions, method, scatter
from station.domain.methods.method import FitProblem
from station.domain.methods.scatter import SolvedUnits
from station.domain.recipe import directions
from station.domain.recipe.recipe import Recipe
from station.service.fleet import PORTION
from tests.fakes import tumble

NOISE = 1e-4
GOAL = 50.0


def main() -> None:
    """Prints solves a second and ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=4096)
    parser.add_argument("--runs", type=int, default=5)
    options = parser.parse_args()
    ups = {f"p{i:02d}": up for i, up in enumerate(directions.SOLIDS[24])}
    kind, batches = fleet(tumble.recipe("n-point", ups=ups), options.units)
    six, of_faces = fleet(tumble.recipe("six-point"), options.units)
    check(kind, batches[0])
    check(six, of_faces[0])
    few, faces, true = batches[0].mean[:40], of_faces[0].mean[:40], batches[0].true[0]
    scipys, imucals = f"scipy {version('scipy')} least_squares", f"imucal {version('imucal')} (six faces)"
    works: dict[str, tuple[Callable[[], object], int]] = {
        "bulk": (lambda: in_turn(kind, batches), options.units),
        "bulk, six faces": (lambda: in_turn(six, of_faces), options.units),
        "one at a time": (lambda: [whole(kind, batches[0].take(slice(u, u + 1))) for u in range(len(few))], len(few)),
        scipys: (lambda: [by_scipy(mean, true) for mean in few], len(few)),
        imucals: (lambda: [by_imucal(mean) for mean in faces], len(faces)),
    }
    rates = {name: rate(name, *work, options.runs) for name, work in works.items()}
    tell(rates, scipys, "", options.runs)
    tell(rates, imucals, f"; bulk on six faces {rates['bulk, six faces'] / rates[imucals]:.0f} ×", options.runs)


def rate(name: str, work: Callable[[], object], count: int, runs: int) -> float:
    """Calibrations a second of processor, median of several runs, of work that solves so many."""
    work()  # imports and caches are paid once
    took = [timed(work) / count for _ in range(runs)]
    spread = (max(took) - min(took)) / statistics.median(took)
    found = 1 / statistics.median(took)
    print(f"  {name:<32} {found:>10,.0f} a second of processor   spread {spread:.0%} of {runs} runs")
    return found


def tell(rates: dict[str, float], peer: str, more: str, runs: int) -> None:
    """The ratio of bulk to a peer."""
    ratio = rates["bulk"] / rates[peer]
    each = f"{rates['bulk']:,.0f} against {rates[peer]:,.0f} a second of processor; {runs} runs"
    figures.keep(10, "calibrations solved in bulk", f"{ratio:.0f} × ({each}{more})", peer, ">= 50 ×", ratio >= GOAL)
    print(f"  bulk / {peer:<25} {ratio:>10.0f}   goal >= {GOAL:g}   {'met' if ratio >= GOAL else 'MISSED'}{more}")


def fleet(recipe: Recipe, units: int) -> tuple[method.Method, list[FitProblem]]:
    """A recipe's method, and the problems of so many units, as many at a time as a backtest takes."""
    rng = np.random.default_rng(1)
    true = tumble.truths(recipe)
    mean = tumble.readings(tumble.units(rng, units), true)
    problem = bench(mean + NOISE * rng.standard_normal(mean.shape), true)
    return method.of(recipe), [problem.take(slice(a, a + PORTION)) for a in range(0, units, PORTION)]


def check(kind: method.Method, problem: FitProblem) -> None:
    """Stops the benchmark if one unit alone gets another answer than among many."""
    together = whole(kind, problem)
    for u in range(50):
        alone = whole(kind, problem.take(slice(u, u + 1)))[0]
        assert np.array_equal(together[u], alone), "one alone differs from many together"


def timed(work: Callable[[], object]) -> float:
    """Seconds of processor time of one call: a machine that does other things as well does not enter."""
    begun = time.process_time()
    work()
    return time.process_time() - begun


def bench(mean: Floats, true: Floats) -> FitProblem:
    """The problem of units (u) with equal noise."""
    u, v, _ = mean.shape
    return FitProblem(
        mean=mean,
        cov=np.tile(NOISE**2 * np.eye(3), (u, v, 1, 1)),
        quantisation=np.zeros((u, v, 3)),
        rounding=np.zeros((u, v, 3)),
        dof=np.full((u, v, 3), 1e6),
        temperature_degC=np.full((u, v), np.nan),
        true=np.broadcast_to(true, mean.shape),
        magnitude=np.ones((u, v)),
        pose=np.arange(v),
        pose_std_rad=0.0,
        scatter_pose=np.zeros(u),
        scatter_visit=np.zeros(u),
        patterns=np.zeros((0, v, 3)),
        nuisance=np.zeros((v, 0)),
        model="matrix",
        pose_known=True,
    )


def solved(kind: method.Method, problem: FitProblem) -> Iterator[tuple[SolvedUnits, Floats]]:
    """Part by part, with the covariances of its rows (u, 12, 12)."""
    for part in scatter.solve(kind, problem):
        yield part, contributions.noise(part.fit, part.problem.cov)


def in_turn(kind: method.Method, batches: list[FitProblem]) -> None:
    """Batch after batch, each answer dropped as the pipeline drops it once it is judged."""
    for batch in batches:
        for _ in solved(kind, batch):
            pass


def whole(kind: method.Method, problem: FitProblem) -> Floats:
    """Coefficients and covariance side by side (u, 12 + 144)."""
    answers = np.full((len(problem.mean), 12 + 144), np.nan)
    for part, covariance in solved(kind, problem):
        theta = part.fit.theta
        answers[part.units] = np.concatenate([theta, covariance.reshape(len(theta), -1)], axis=1)[part.rows]
    return answers


def by_scipy(mean: Floats, true: Floats) -> tuple[Floats, Floats]:
    """The obvious way."""

    def misfit(p: Floats) -> Floats:
        return np.asarray((true @ p[3:].reshape(3, 3).T + p[:3] - mean).ravel())

    found = least_squares(misfit, np.r_[np.zeros(3), np.eye(3).ravel()])
    return found.x, NOISE**2 * np.linalg.inv(found.jac.T @ found.jac)


def by_imucal(mean: Floats) -> object:
    """imucal on the six faces, in the order of the recipe, as arrays of one reading."""
    from imucal import FerrarisCalibration, FerrarisSignalRegions

    names = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a")
    acc = {f"acc_{n}": mean[i : i + 1] for i, n in enumerate(names)}
    gyr = {f"gyr_{n}": np.zeros((1, 3)) for n in names}
    turns = {f"{k}_{a}_rot": np.eye(3)[[i]] for k in ("acc", "gyr") for i, a in enumerate("xyz")}
    regions = FerrarisSignalRegions(**acc, **gyr, **turns)
    return FerrarisCalibration().compute(regions, 100.0, from_acc_unit="m/s^2", from_gyr_unit="deg/s")


if __name__ == "__main__":
    main()
