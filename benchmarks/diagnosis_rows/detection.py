"""Rows 1 and 2: alarms where nothing is wrong; and how strong a cause must be, against the test told its form."""

from functools import partial

import numpy as np
from diagnosis_rows import oracle
from diagnosis_rows.bank_bound import least_ratio
from diagnosis_rows.figures import Array, Figure, at_most, bootstrapped, share
from diagnosis_rows.trials import First, Request, first_diagnosis
from scipy.stats import norm

from tests.blind.hidden import KNOWN

#: Of the largest share of false alarms, by floor.
FALSE_ALARMS = {"white": 0.015, "full": 0.02, "t5": 0.03}
#: Amplitudes tried, times that at which the test told the form fires in 80 of 100.
STEPS = (1.0, 1.12, 1.25, 1.4, 1.6)


def false_alarms(seed: int, sets: int) -> list[Figure]:
    """Row 1."""
    found = []
    for i, (floor, most) in enumerate(FALSE_ALARMS.items()):
        asks = [Request("", floor, seed * 10**6 + 10**5 * i + n) for n in range(100 * sets)]
        fired = [_shown(a, first_diagnosis(a)) for a in asks]
        found.append(share(f"false alarms at 1 %, floor {floor}", fired, partial(at_most, goal=most)))
    return found


def _shown(request: Request, first: First) -> bool:
    if first.alarms:
        print(f"    {request}: {first.statistic:.2f} > {first.threshold:.2f}", flush=True)
    return first.alarms


def power(seed: int, sets: int) -> list[Figure]:
    """Row 2."""
    causes = sorted(KNOWN)
    needed = np.array([oracle.form(name).needed() for name in causes])
    rows = []
    for i, name in enumerate(causes):
        for j, step in enumerate(STEPS):
            for n in range(sets):
                request = Request(name, "white", seed * 10**6 + 300_000 + 1000 * i + 100 * j + n, d=step * needed[i])
                first = first_diagnosis(request)
                rows.append((i, step * needed[i], first.statistic, first.threshold))
    data = np.array(rows)
    ratio = thresholds(data, len(causes)) / needed
    for i in np.argsort(ratio)[::-1]:
        print(f"    {causes[i]:<24} {ratio[i]:.2f}   of the oracle's d = {needed[i]:.2f}")
    # The same causes each time, other noise: a cause's own rows are drawn anew.
    return [
        bootstrapped(
            f"amplitude for 80 % power ÷ form oracle, mean of {len(causes)}",
            lambda at: float(np.mean(thresholds(data[_within(data[:, 0], at)], len(causes)) / needed)),
            len(data),
            lambda r: at_most(r, 1.20),
        ),
        least_possible(),
        share("  it alarms at 1.25 times the oracle's amplitude", _alarms_at(data, needed, 1.25)),
    ]


def least_possible() -> Figure:
    """What no search among so many causes can undercut."""
    bound = least_ratio()
    return Figure("  the least that a search for all of them can reach", bound, bound, bound, len(KNOWN))


def thresholds(data: Array, causes: int) -> Array:
    """The d (causes) of 80 % power, from rows (n, 4) of cause, d, statistic and threshold.

    The root of twice a log-likelihood ratio grows as d and scatters as a normal deviate of 1; so does, nearly, that of
    the alarm's statistic. One slope and one scatter serve all causes, each has its own intercept.
    """
    cause, d = data[:, 0].astype(int), data[:, 1]
    y, least = (np.sqrt(2 * np.log(10) * np.maximum(x, 0.0)) for x in data[:, 2:].T)
    centre = np.array([[x[cause == i].mean() for x in (d, y)] for i in range(causes)])
    dx, dy = d - centre[cause, 0], y - centre[cause, 1]
    slope = float(dx @ dy / (dx @ dx))
    scatter = float(np.sqrt(np.sum((dy - slope * dx) ** 2) / max(len(d) - causes - 1, 1)))
    return np.asarray(centre[:, 0] + (least.mean() + norm.ppf(oracle.POWER) * scatter - centre[:, 1]) / slope)


def _within(cause: Array, at: Array) -> Array:
    """Rows drawn anew (n) among those of the same cause."""
    rng = np.random.default_rng(int(at.sum()))
    if np.array_equal(at, np.arange(len(at))):
        return at
    return np.concatenate([rng.choice(np.flatnonzero(cause == i), np.sum(cause == i)) for i in np.unique(cause)])


def _alarms_at(data: Array, needed: Array, step: float) -> list[bool]:
    near = np.isclose(data[:, 1], step * needed[data[:, 0].astype(int)])
    return [bool(x) for x in data[near, 2] > data[near, 3]]
