"""How good the calibrations are: against the Cramér–Rao bound, peers on the same draws, and their own intervals.

    python benchmarks/calibration.py [--draws 4000] [--intervals 10000] [--units 100000] [--only NAME]

Every draw goes through the samples table and the one pipeline of run and command. Peers are their published formulas
on the same position means: ST DT0105 three-point, imucal's six-point (2 of 6 readings for an offset), and the inverse
regression of AN4508 (also librealsense's), once on means and once on raw samples. About three minutes.
"""

import argparse
import time
from collections.abc import Callable, Sequence

import numpy as np
from scipy.signal import lfilter

from station.domain.core import rotation
from station.domain.core.types import Floats, Outcome
from station.domain.evaluation import pipeline
from station.domain.methods.calibrate import _ellipsoid
from station.domain.recipe import directions, gravity
from station.domain.recipe.recipe import Recipe
from tests.fakes import tumble

NOISE, READINGS = 1e-3, 100
#: One unit for every draw, so that the bound is one number: 20 mg of offset, 1 % of cross-axis.
UNIT = np.r_[0.02, -0.01, 0.015, 1.01, 0.008, -0.012, -0.006, 0.99, 0.01, 0.004, -0.009, 1.02]
#: A true linear fit scatters about 1 by √(2/draws) in the ratio of one coefficient.
GRAVITY_PPM = {
    "equator": (0.0, 0.0, -2684),
    "Singapore": (1.29, 0.0, -2686),
    "Mexico City": (19.43, 2240.0, -2806),
    "Denver": (39.74, 1609.0, -1035),
    "45 degrees": (45.0, 0.0, -46),
    "Munich": (48.14, 520.0, 80),
    "Helsinki": (60.17, 0.0, 1285),
    "pole": (90.0, 0.0, 2604),
}


def main() -> None:
    """Prints every row."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=4000)
    parser.add_argument("--intervals", type=int, default=10_000)
    parser.add_argument("--units", type=int, default=100_000)
    parser.add_argument("--only", choices=["bound", "coverage", "fixture", "accept", "gravity"])
    options = parser.parse_args()
    rows: dict[str, Callable[[], None]] = {
        "bound": lambda: bound(options.draws),
        "coverage": lambda: coverage(options.intervals),
        "fixture": lambda: fixture(options.draws),
        "accept": lambda: accept(options.units),
        "gravity": site_gravity,
    }
    for name, row in rows.items():
        if options.only in (None, name):
            begun = time.perf_counter()
            row()
            print(f"  ({time.perf_counter() - begun:.0f} s)\n")


def shown(what: str, figure: float, goal: str, met: bool) -> None:
    """One row."""
    print(f"  {what:<58} {figure:>9.4g}   goal {goal:<10} {'met' if met else 'MISSED'}")


def on(method: str, ups: Floats) -> Recipe:
    """A recipe with the device's axes `ups` up, one position each."""
    return tumble.recipe(method, ups={f"p{i:02d}": up for i, up in enumerate(ups)})


def run(
    recipe: Recipe, mean: Floats, noise: Floats | float, count: int, rng: np.random.Generator
) -> tuple[Floats, Floats, Floats]:
    """Coefficients (u, 12), standard deviations (u, 12) and measured means (u, v, 3) of units by the pipeline."""
    found = list(pipeline.calibrate(recipe, tumble.table(recipe, mean, noise, count, rng), tumble.TODAY))
    theta = np.array([tumble.coefficients(r) for r in found])
    std = np.array([r.budget.std() for r in found if r.budget is not None])
    return theta, std, np.array([r.visits.mean for r in found if r.visits is not None])


def bound(draws: int) -> None:
    """Variance of each coefficient over the Cramér–Rao bound, peers beside."""
    print(f"variance / Cramér–Rao bound, {draws} draws of {READINGS} readings, white noise of {NOISE:g}")
    rng = np.random.default_rng(1)
    slack = 3 * np.sqrt(2 / draws)
    for method, ups in (("six-point", directions.AXES), ("n-point", directions.ICOSAHEDRON)):
        recipe = on(method, ups)
        theta, _, means = run(recipe, tumble.readings(np.tile(UNIT, (draws, 1)), ups), NOISE, READINGS, rng)
        T = np.column_stack([np.ones(len(ups)), ups])
        own = np.diagonal(np.linalg.inv(T.T @ T)) * NOISE**2 / READINGS
        crb = np.r_[np.full(3, own[0]), np.tile(own[1:], 3)]
        ratio = ((theta - UNIT) ** 2).mean(axis=0) / crb
        shown(f"{method}, mean over the 12 coefficients", ratio.mean(), "<= 1.03", ratio.mean() <= 1.03)
        print(f"    each: {ratio.min():.3f} to {ratio.max():.3f}; chance alone spreads one by ± {slack:.3f}")
        peers(method, means, ups, crb, draws)
    norm_bound(draws, rng)


def peers(method: str, means: Floats, ups: Floats, crb: Floats, draws: int) -> None:
    """Formulas of others on the same means; ratios of their offsets and gains to the same bound."""
    formulas: dict[str, Callable[[Floats], Floats]] = {"AN4508, inverse regression on means": lambda m: inverse(m, ups)}
    if method == "six-point":
        formulas |= {"imucal (offset from the ± pair)": imucal, "DT0105 three-point formula": dt0105}
    for name, formula in formulas.items():
        error = formula(means) - UNIT
        ratio = (error**2).mean(axis=0) / crb
        gains = ratio[[3, 7, 11]].mean()
        print(f"    {name:<40} offset {ratio[:3].mean():8.3g}   gain {gains:8.3g}")
    rng = np.random.default_rng(2)
    raw = means[: draws // 10, :, None] + NOISE * rng.standard_normal((draws // 10, len(ups), READINGS, 3))
    bias = np.mean([inverse(r.reshape(1, -1, 3), np.repeat(ups, READINGS, axis=0))[0, [3, 7, 11]] for r in raw], axis=0)
    print(f"    AN4508 fed raw samples: bias of the gains {np.mean(bias - UNIT[[3, 7, 11]]):+.2g}")


def imucal(means: Floats) -> Floats:
    """Offsets from each axis' own pair, matrix from the pairs' differences (faces in the order +x −x +y −y +z −z)."""
    plus, minus = means[:, ::2], means[:, 1::2]
    offset = np.einsum("uii->ui", plus + minus) / 2
    matrix = (plus - minus).transpose(0, 2, 1) / 2
    return np.concatenate([offset, matrix.reshape(-1, 9)], axis=1)


def dt0105(means: Floats) -> Floats:
    """Three of the six positions: offsets by the two off-axis readings, gains by on-axis less offset."""
    up = means[:, ::2]
    offset = (up.sum(axis=1) - np.einsum("uii->ui", up)) / 2
    gain = np.einsum("uii->ui", up) - offset
    matrix = np.zeros((len(up), 3, 3))
    matrix[:, range(3), range(3)] = gain
    return np.concatenate([offset, matrix.reshape(-1, 9)], axis=1)


def inverse(means: Floats, true: Floats) -> Floats:
    """true = X·(reading, 1) by least squares, then turned round."""
    w = np.concatenate([means, np.ones((*means.shape[:2], 1))], axis=2)
    X = np.linalg.pinv(w) @ true
    matrix = np.linalg.inv(X[:, :3].transpose(0, 2, 1))
    offset = -(matrix @ X[:, 3, :, None])[..., 0]
    return np.concatenate([offset, matrix.reshape(-1, 9)], axis=1)


def norm_bound(draws: int, rng: np.random.Generator) -> None:
    """Offsets and the upper triangular matrix of the norm fit; its bound has the poses as unknowns."""
    for ups, name in ((directions.ICOSAHEDRON, "12"), (directions.SOLIDS[18], "18")):
        recipe = on("norm", ups)
        mean = tumble.readings(np.tile(UNIT, (draws, 1)), ups)
        theta, _, _ = run(recipe, mean, NOISE, READINGS, rng)
        error = upper(theta) - upper(UNIT[None])
        matrix = UNIT[3:].reshape(3, 3)
        J = jacobian_of_upper(ups, matrix)
        crb = np.diagonal(np.linalg.inv(J.T @ J)) * NOISE**2 / READINGS
        ratio = (error**2).mean(axis=0) / crb
        shown(f"norm on {name} positions, mean over its 9", ratio.mean(), "<= 1.06", ratio.mean() <= 1.06)
        print(f"    each: {ratio.min():.3f} to {ratio.max():.3f}")


def upper(theta: Floats) -> Floats:
    """Offset and the upper triangular U with U·Uᵀ = A·Aᵀ: (u, 9). The reversal turns Cholesky's lower into upper."""
    A = theta[:, 3:].reshape(-1, 3, 3)
    U = np.linalg.cholesky((A @ A.transpose(0, 2, 1))[:, ::-1, ::-1])[:, ::-1, ::-1]
    return np.concatenate([theta[:, :3], U[:, _ellipsoid.ROWS, _ellipsoid.COLUMNS]], axis=1)


def jacobian_of_upper(ups: Floats, matrix: Floats) -> Floats:
    """Rows of the information about (offset, U) from readings whose direction is unknown (v, 9).

    A reading moves freely in the two directions that a turn of the pose gives it; along the third, the ellipsoid's
    normal m = A⁻ᵀt, it informs: d(m·y)/d(offset, U) / |m|.
    """
    U = upper(np.r_[np.zeros(3), matrix.ravel()][None])[0, 3:]
    full = np.zeros((3, 3))
    full[_ellipsoid.ROWS, _ellipsoid.COLUMNS] = U
    Q = np.linalg.solve(full, matrix)
    observed = ups @ Q.T
    normal = np.linalg.solve(full.T, observed.T).T
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.concatenate([normal, normal[:, _ellipsoid.ROWS] * observed[:, _ellipsoid.COLUMNS]], axis=1)


def coverage(draws: int) -> None:
    """How many of all coefficients lie within ± 1.96 of their standard deviations."""
    print(f"coverage of 95 % intervals, six-point, {draws} draws of {READINGS} readings")
    for phi in (0.0, 0.5, 0.8, 0.9):
        rng = np.random.default_rng(3)
        inside = total = 0
        for part in np.array_split(np.arange(draws), max(draws // 2000, 1)):
            theta = tumble.units(rng, len(part))
            recipe = tumble.recipe("six-point")
            e = rng.standard_normal((len(part), 6, READINGS + 200, 3))
            noise = NOISE * np.sqrt(1 - phi**2) * lfilter([1.0], [1.0, -phi], e, axis=2)[:, :, 200:]
            found, std, _ = run(recipe, tumble.readings(theta, tumble.truths(recipe)), noise, READINGS, rng)
            inside += int((np.abs(found - theta) < 1.96 * std).sum())
            total += found.size
        share = inside / total
        shown(f"noise of first order, φ = {phi:g}", share, "0.94–0.96", 0.94 <= share <= 0.96)


def fixture(draws: int) -> None:
    """Error of the magnitude where every pose is off by 0.2° about each axis, 0.2 mg of noise a position."""
    print(f"poses off by 0.2° sd about each axis, {draws // 4} units, rms error of |a| in mg")
    rng = np.random.default_rng(4)
    direction = tumble.truths(on("n-point", directions.spread(300)))
    for method, ups in (
        ("norm", directions.ICOSAHEDRON),
        ("six-point", directions.AXES),
        ("n-point", directions.ICOSAHEDRON),
    ):
        recipe, n = on(method, ups), draws // 4
        theta = tumble.units(rng, n)
        R = rotation.from_vector(np.deg2rad(0.2) * rng.standard_normal((n, len(ups), 3)))
        true = (R @ tumble.truths(recipe)[..., None])[..., 0]
        found, _, _ = run(recipe, tumble.readings(theta, true), 2e-4 * np.sqrt(20), 20, rng)
        corrected = np.linalg.solve(
            found[:, None, 3:].reshape(-1, 1, 3, 3), (tumble.readings(theta, direction) - found[:, None, :3])[..., None]
        )[..., 0]
        rms = 1e3 * float(np.sqrt(((np.linalg.norm(corrected, axis=2) - 1) ** 2).mean()))
        if method == "norm":
            shown("norm, 12 positions", rms, "<= 0.2", rms <= 0.2)
        else:
            print(f"    {method} on {len(ups)} positions: {rms:.3g}")


def accept(units: int) -> None:
    """Units exactly at their limit, noise and limit such that chance decides: how many pass."""
    print(f"false accepts at a guard-banded limit, {units} units at the limit of one offset")
    limit = 0.05
    for rule, stated in (("guard-band", 0.0228), ("false-accept", 0.01)):
        more = {"false_accept": stated} if rule == "false-accept" else {}
        recipe = tumble.recipe("three-point", limits={"offset": limit, "rule": rule, **more})
        rng = np.random.default_rng(5)
        passed = 0
        for part in np.array_split(np.arange(units), max(units // 10_000, 1)):
            theta = np.tile([0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1.0], (len(part), 1))
            theta[:, 0] = limit
            mean = tumble.readings(theta, tumble.truths(recipe))
            table = tumble.table(recipe, mean, 0.02, 12, rng)
            passed += sum(r.verdict.outcome is Outcome.PASS for r in pipeline.calibrate(recipe, table, tumble.TODAY))
        rate, spread = passed / units, np.sqrt(stated / units)
        shown(
            f"rule {rule}, stated {stated:g}, spread ± {spread:.2g}",
            rate,
            f"<= {stated:g}",
            rate <= stated + 2 * spread,
        )


def site_gravity() -> None:
    """Against published values, ppm from 9.80665."""
    print("gravity at the site against published values at eight places")
    off: Sequence[float] = [
        (gravity.normal_gravity(latitude, altitude) / gravity.STANDARD - 1) * 1e6 - ppm
        for latitude, altitude, ppm in GRAVITY_PPM.values()
    ]
    worst = float(np.abs(off).max())
    shown("largest difference, ppm", worst, "<= 20", worst <= 20)


if __name__ == "__main__":
    main()
