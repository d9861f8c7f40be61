"""Calibrations solved a second, covariance included, in bulk and one at a time, against SciPy and imucal.

    python benchmarks/solving.py [--units 4096] [--runs 5]

24 positions, 12 coefficients, from position means. The bulk solver is that of run, recompute and backtest; its answers
for many units are bit for bit those for one. Peers: scipy.optimize.least_squares (12 parameters, its Jacobian, and the
covariance from it) started at a perfect sensor; imucal's own class on six faces (which is all it knows), with no
covariance.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version

import figures
import numpy as np
from scipy.optimize import least_squares

from station.domain import directions, method, scatter
from station.domain.method import Problem
from station.domain.pipeline import BATCH
from station.domain.types import Floats
from station.domain.uncertainty import covariance_of_noise
from tests.fakes import tumble

NOISE = 1e-4
GOAL = 50.0


def main() -> None:
    """Prints solves a second and ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=4096)
    parser.add_argument("--runs", type=int, default=5)
    options = parser.parse_args()
    ups = directions.SOLIDS[24]
    recipe = tumble.recipe("n-point", ups={f"p{i:02d}": up for i, up in enumerate(ups)})
    rng = np.random.default_rng(1)
    theta = tumble.units(rng, options.units)
    true = tumble.truths(recipe)
    problem = bench(tumble.readings(theta, true) + NOISE * rng.standard_normal((options.units, 24, 3)), true)
    kind = method.of(recipe)

    batches = [problem.take(np.arange(a, min(a + BATCH, options.units))) for a in range(0, options.units, BATCH)]
    batches = [replace(b, true=np.broadcast_to(true, b.mean.shape)) for b in batches]

    together = [solved(kind, batch) for batch in batches]
    answers = np.concatenate([whole(*part) for part in together])
    alone = [one(kind, problem, u) for u in range(50)]
    assert all(np.array_equal(answers[u], alone[u]) for u in range(50)), "one alone differs from many together"
    few = min(options.units, 40)
    peers: dict[str, tuple[Callable[[], None], int]] = {
        "bulk": (lambda: in_turn(kind, batches), options.units),
        "one at a time": (lambda: [one(kind, problem, u) for u in range(few)], few),
        f"scipy {version('scipy')} least_squares": (lambda: [by_scipy(problem.mean[u], true) for u in range(few)], few),
        f"imucal {version('imucal')} (six faces)": (lambda: [by_imucal(problem.mean[u]) for u in range(few)], few),
    }
    rates = {}
    for name, (work, count) in peers.items():
        work()  # imports and caches are paid once
        took = [timed(work) / count for _ in range(options.runs)]
        rates[name] = 1 / statistics.median(took)
        spread = (max(took) - min(took)) / statistics.median(took)
        print(f"  {name:<32} {rates[name]:>10,.0f} a second of processor   spread {spread:.0%} of {options.runs} runs")
    for name in list(peers)[2:]:
        ratio = rates["bulk"] / rates[name]
        each = f"{rates['bulk']:,.0f} against {rates[name]:,.0f} a second of processor; {options.runs} runs"
        figures.keep(10, "calibrations solved in bulk", f"{ratio:.0f} × ({each})", name, ">= 50 ×", ratio >= GOAL)
        print(f"  bulk / {name:<25} {ratio:>10.0f}   goal >= {GOAL:g}   {'met' if ratio >= GOAL else 'MISSED'}")


def timed(work: Callable[[], object]) -> float:
    """Seconds of processor time of one call: a machine that does other things as well does not enter."""
    begun = time.process_time()
    work()
    return time.process_time() - begun


def bench(mean: Floats, true: Floats) -> Problem:
    """The problem of units (u) with equal noise."""
    u, v, _ = mean.shape
    return Problem(
        mean=mean,
        cov=np.tile(NOISE**2 * np.eye(3), (u, v, 1, 1)),
        quantisation=np.zeros((u, v, 3)),
        dof=np.full((u, v, 3), 1e6),
        temperature_degC=np.full((u, v), np.nan),
        true=np.tile(true, (u, 1, 1)),
        magnitude=np.ones((u, v)),
        pose=np.arange(v),
        pose_std_rad=0.0,
        scatter_pose=np.zeros(u),
        scatter_stop=np.zeros(u),
        nuisance=np.zeros((v, 0)),
        model="matrix",
        pose_known=True,
    )


def one(kind: method.Method, problem: Problem, u: int) -> Floats:
    """One unit by the same solver."""
    return np.asarray(whole(*solved(kind, problem.take(np.array([u]))))[0])


def solved(kind: method.Method, problem: Problem) -> tuple[Floats, Floats]:
    """Coefficients (u, 12) and their covariances (u, 12, 12)."""
    found, fit = scatter.solve(kind, problem)
    return fit.theta, covariance_of_noise(fit, found.cov)


def in_turn(kind: method.Method, batches: list[Problem]) -> None:
    """Batch after batch, each answer dropped as the pipeline drops it once it is judged."""
    for batch in batches:
        solved(kind, batch)


def whole(theta: Floats, covariance: Floats) -> Floats:
    """Coefficients and covariance side by side (u, 12 + 144)."""
    return np.concatenate([theta, covariance.reshape(len(theta), -1)], axis=1)


def by_scipy(mean: Floats, true: Floats) -> tuple[Floats, Floats]:
    """The obvious way."""

    def misfit(p: Floats) -> Floats:
        return np.asarray((true @ p[3:].reshape(3, 3).T + p[:3] - mean).ravel())

    found = least_squares(misfit, np.r_[np.zeros(3), np.eye(3).ravel()])
    return found.x, NOISE**2 * np.linalg.inv(found.jac.T @ found.jac)


def by_imucal(mean: Floats) -> object:
    """imucal on six of the positions, as arrays of one reading."""
    from imucal import FerrarisCalibration, FerrarisSignalRegions

    names = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a")
    acc = {f"acc_{n}": mean[i : i + 1] for i, n in enumerate(names)}
    gyr = {f"gyr_{n}": np.zeros((1, 3)) for n in names}
    turns = {f"{k}_{a}_rot": np.eye(3)[[i]] for k in ("acc", "gyr") for i, a in enumerate("xyz")}
    regions = FerrarisSignalRegions(**acc, **gyr, **turns)
    return FerrarisCalibration().compute(regions, 100.0, from_acc_unit="m/s^2", from_gyr_unit="deg/s")


if __name__ == "__main__":
    main()
