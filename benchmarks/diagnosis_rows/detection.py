"""Rows 1 and 2: alarms where nothing is wrong; and how strong a cause must be, against the test told its form."""

import numpy as np
from scipy.optimize import minimize
from scipy.stats import norm

from benchmarks.diagnosis_rows import oracle
from benchmarks.diagnosis_rows.figures import Array, Figure, at_most, bootstrapped, share
from benchmarks.diagnosis_rows.trials import Ask, alarms
from tests.blind.hidden import KNOWN

#: Of the largest share of false alarms, by floor.
FALSE_ALARMS = {"white": 0.015, "full": 0.02, "t5": 0.03}
#: Amplitudes tried, times that at which the test told the form fires in 80 of 100.
STEPS = (0.9, 1.05, 1.2, 1.4, 1.7)


def false_alarms(seed: int, sets: int) -> list[Figure]:
    """Row 1."""
    runs = max(20, 100 * sets)
    found = []
    for i, (floor, most) in enumerate(FALSE_ALARMS.items()):
        fired = [alarms(Ask("", floor, seed * 10**6 + 10**5 * i + n)) for n in range(runs)]
        found.append(share(f"false alarms at 1 %, floor {floor}", fired, lambda p, most=most: at_most(p, most)))
    return found


def power(seed: int, sets: int) -> list[Figure]:
    """Row 2."""
    causes = sorted(KNOWN)
    needed = {name: oracle.form(name).needed() for name in causes}
    rows = []
    for i, name in enumerate(causes):
        for j, step in enumerate(STEPS):
            for n in range(sets):
                ask = Ask(name, "white", seed * 10**6 + 300_000 + 1000 * i + 100 * j + n, d=step * needed[name])
                rows.append((i, np.log(step), alarms(ask)))
    data = np.array(rows, float)
    ratio = bootstrapped(
        f"amplitude for 80 % power ÷ form oracle, mean of {len(causes)} causes",
        lambda at: float(np.exp(np.mean(_thresholds(data[at], len(causes))))),
        len(data),
        lambda r: at_most(r, 1.20),
        draws=60,
    )
    each = np.exp(_thresholds(data, len(causes)))
    worst = np.argsort(each)[::-1]
    told = ", ".join(f"{causes[i]} {each[i]:.2f}" for i in worst)
    print(f"    each (oracle's d: {', '.join(f'{n} {d:.2f}' for n, d in needed.items())})")
    print(f"    each ratio: {told}")
    return [ratio]


def _thresholds(data: Array, causes: int) -> Array:
    """Log amplitude (causes) of 80 % power of rows (n, 3) of cause, log amplitude, alarm: a normal curve each, of one
    common steepness; the places scatter about their mean as normal deviates of .15, which holds those of few alarms."""
    cause, x, fired = data[:, 0].astype(int), data[:, 1], data[:, 2] > 0.5

    def loss(p: Array) -> float:
        z = (x - p[cause]) / np.exp(p[-1])
        likelihood = np.sum(norm.logcdf(np.where(fired, z, -z)))
        places = p[:-2]
        return float(-likelihood + np.sum((places - p[-2]) ** 2) / (2 * 0.15**2) + 2 * (p[-1] - np.log(0.2)) ** 2)

    start = np.r_[np.zeros(causes), 0.0, np.log(0.2)]
    best = minimize(loss, start, method="L-BFGS-B").x
    return np.asarray(best[:-2] + norm.ppf(oracle.POWER) * np.exp(best[-1]))
