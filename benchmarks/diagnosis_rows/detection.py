"""Rows 1 and 2: alarms where nothing is wrong; and how strong a cause must be, against the test told its form."""

from functools import partial

import numpy as np
from diagnosis_rows import oracle
from diagnosis_rows.bank_bound import SHARES, STILL, AllForms, least_ratio
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
    multiple, fired = data[:, 1] / needed[data[:, 0].astype(int)], data[:, 2] > data[:, 3]
    for step in STEPS:
        near = fired[np.isclose(multiple, step)]
        print(f"    at {step:g} times the oracle's amplitude {near.sum()} of {len(near)} alarm")
    return [
        bootstrapped(
            f"amplitude for 80 % power ÷ form oracle, {len(causes)} causes alike",
            lambda at: multiple_for_power(multiple[at], fired[at]),
            len(data),
            lambda r: at_most(r, 1.20),
        ),
        *least_possible(),
        share("  it alarms at 1.25 times the oracle's amplitude", fired[np.isclose(multiple, 1.25)].tolist()),
    ]


def least_possible() -> list[Figure]:
    """What no search among so many causes can undercut: told that nothing walks; and where a healthy floor may."""
    of = AllForms.of(1)
    still, _ = least_ratio(of, STILL)
    walking, alone = max((least_ratio(of, shares) for shares in SHARES), key=lambda found: found[0])
    most = sorted(alone, key=lambda name: -alone[name])[:5]
    note = ", ".join(f"{name} {alone[name]:.2f}" for name in most)
    words = "  the least that a search for all of them can reach"
    return [
        Figure(words, still, still, still, len(KNOWN)),
        Figure(f"{words} where a floor may walk", walking, walking, walking, len(KNOWN), note=note),
    ]


def multiple_for_power(multiple: Array, fired: Array) -> float:
    """The multiple of the oracle's amplitude at which 80 of 100 alarm: a normal distribution function of its logarithm,
    by maximum likelihood. The alarm's statistic itself is 0 below what a cause may be named for, and is no measure."""
    middle, width = (x.ravel() for x in np.meshgrid(np.linspace(-0.3, 0.7, 201), np.linspace(0.04, 0.5, 24)))
    z = (np.log(multiple)[:, None] - middle) / width + norm.ppf(oracle.POWER)
    nats = np.where(fired[:, None], norm.logcdf(z), norm.logcdf(-z)).sum(axis=0)
    return float(np.exp(middle[nats.argmax()]))
