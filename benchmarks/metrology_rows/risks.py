"""Stated risks against what is truly beyond a limit."""

import numpy as np
from metrology_rows.bench import Bench
from metrology_rows.designs import READINGS, Floats, recipe
from metrology_rows.report import Report
from scipy.special import ndtr

from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.line_quality import history
from station.domain.recipe.recipe import Recipe

OFFSET_LIMIT, GAIN_LIMIT = 0.03, 0.015
#: Of units of one station, gains: standard deviation of a process, and of gravity, which nobody knows there.
PROCESS, GRAVITY = 0.01, 0.003
STATIONS, LEARNT_FROM = 400, 40
#: Of bench.Bench's offsets; of one reading where the process is learnt.
OFFSET_PROCESS, LEARNT_NOISE = 0.02, 0.03


def risks(units: int, report: Report) -> None:
    """Stated specific risks of false acceptance over units of a stated process, against what is truly beyond."""
    process = {"offset": [0, 0.02], "gain": [0, PROCESS]}
    of = recipe("n18", limits={"offset": OFFSET_LIMIT, "gain": GAIN_LIMIT, "process": process})
    bench = Bench(of, 4 * units, report, 90)
    noise = 0.06 * bench.rng.standard_normal((4 * units, len(bench.poses), READINGS, 3))
    stated, true, passed = counted(bench, bench.results(bench.readings(bench.truth(), noise)))
    ratio = stated / max(true, 1)
    more = f"stated {stated:.1f}, true {true:.0f} of {passed:.0f} passed"
    report.show("stated ÷ true risk, simple rule", 90, ratio, (0.8, 1.25), ratio / max(true, 1) ** 0.5, more)


def counted(bench: Bench, results: list[CalibrationResult]) -> tuple[float, float, float]:
    """Sum of the stated risks, units that are beyond a limit and passed, units that passed."""
    passed = np.array([r.verdict.outcome == "PASS" for r in results])
    gains = np.diagonal(bench.matrix, axis1=1, axis2=2) - 1
    beyond = (np.abs(bench.offset) > OFFSET_LIMIT).any(axis=1) | (np.abs(gains) > GAIN_LIMIT).any(axis=1)
    return sum(r.verdict.false_accept for r in results), float((beyond & passed).sum()), float(passed.sum())


def learnt(units: int, report: Report) -> None:
    """The same where each of many stations learns the process from results of its own, which share an error of gravity
    that nobody knows there. Where a process has its mean shows in the results only together with that error."""
    for what, centre, independent, seed in (
        ("means twice their units' spread", 2 * PROCESS, 3, 700),
        ("means drawn like their units", PROCESS, 3, 200),
        ("means like them, alike in all axes", PROCESS, 1, 500),
        ("means exactly at nominal", 0.0, 3, 900),
    ):
        generators = [report.generator(seed, i) for i in range(STATIONS)]
        means = [centre * rng.standard_normal(independent) * np.ones(3) for rng in generators]
        each = np.array([one_station(units // 80, *own, report) for own in zip(generators, means, strict=True)])
        stated, true, passed = each.sum(axis=0)
        ratio = stated / max(true, 1)
        # Units of a station are right or wrong together: the spread is that of stations.
        spread = float(np.sqrt(((each[:, 0] - ratio * each[:, 1]) ** 2).sum()) / max(true, 1))
        more = f"stated {stated:.1f}, true {true:.1f} of {passed:.0f} passed"
        report.show(f"stated ÷ true risk, process learnt, {what}", seed, ratio, (0.8, 1.25), spread, more)


def one_station(count: int, rng: np.random.Generator, mean: Floats, report: Report) -> tuple[float, float, float]:
    """What `counted` says of units of a station that has learnt from earlier ones. mean (3): of the process gains,
    less nominal."""
    of = recipe("n18", {"magnitude_std": GRAVITY}, limits={"offset": OFFSET_LIMIT, "gain": GAIN_LIMIT})
    size = 1 + GRAVITY * rng.standard_normal()

    def measured(by: Recipe, units: int) -> tuple[Bench, list[CalibrationResult]]:
        bench = Bench(by, units, report, int(rng.integers(2**31)))
        bench.matrix = bench.matrix + np.diag(mean)
        noise = LEARNT_NOISE * bench.rng.standard_normal((units, len(bench.poses), READINGS, 3))
        return bench, bench.results(bench.readings(bench.truth(size=size), noise))

    before = measured(of, LEARNT_FROM)[1]
    known = history.learn_history([past(r, i) for i, r in enumerate(before)], np.ones(12, bool), ())
    bench, results = measured(known.applied(of), count)
    stated, _, passed = counted(bench, results)
    return stated, expected_beyond(results, mean, size, len(bench.poses)), passed


def expected_beyond(results: list[CalibrationResult], mean: Floats, size: float, poses: int) -> float:
    """Passed units that are beyond a limit, as many as there are in the mean over all truths that could have given
    these results: by the generator's own process and gravity, in closed form, so that no luck of few units is in it."""
    found = [r.calibration for r in results if r.verdict.outcome == "PASS" and r.calibration is not None]
    offset = np.array([c.offset for c in found]).reshape(-1, 3)
    gain = np.array([np.diagonal(c.matrix) for c in found]).reshape(-1, 3) / size
    noise = LEARNT_NOISE / READINGS**0.5
    inside = within(offset, 0.0, OFFSET_PROCESS, noise / poses**0.5, OFFSET_LIMIT)
    inside = inside * within(gain - 1, mean, PROCESS, noise / (poses / 3) ** 0.5 / size, GAIN_LIMIT)
    return float((1 - inside.prod(axis=1)).sum())


def within(result: Floats, mean: Floats | float, process: float, noise: float, limit: float) -> Floats:
    """Probability that the truth is within ± limit, of a normal process and a result with normal noise."""
    share = process**2 / (process**2 + noise**2)
    centre, std = share * result + (1 - share) * mean, share**0.5 * noise
    return np.asarray(ndtr((limit - centre) / std) - ndtr((-limit - centre) / std))


def past(result: CalibrationResult, number: int) -> history.PastResult:
    """As the log keeps it."""
    assert result.calibration is not None and result.budget is not None
    theta = np.r_[result.calibration.offset, result.calibration.matrix.ravel()]
    parts = {cause: result.budget.std(cause) for cause in result.budget.parts}
    left = result.budget.residuals
    return history.PastResult(f"U{number}", "S/A", "2026-11-22", passed=True, theta=theta, parts=parts, residuals=left)
