"""Row 6: what no cause of the library explains is called unknown, and what is known is not."""

from functools import partial

from diagnosis_rows.figures import Figure, at_least, at_most, share
from diagnosis_rows.naming import NAMING, survey
from diagnosis_rows.trials import Request, Trial, tell_misses, trial

from tests.blind.outside import OUTSIDE

#: Of all data sets, how many must be called unknown or incomplete with the right covariate.
RECALL = {11.0: 0.85, 16.0: 0.93, 30.0: 0.97}
#: How often a cause of the library may be named with certainty (p ≥ .9) for what is none.
CERTAIN = 0.03


def unknown(seed: int, sets: int) -> list[Figure]:
    """Row 6."""
    figures = []
    for d, goal in RECALL.items():
        asks = [
            Request(name, "white", seed * 10**6 + 600_000 + 1000 * round(d) + 10 * n + i, d=d)
            for i, name in enumerate(sorted(OUTSIDE))
            for n in range(sets)
        ]
        trials = [trial(a) for a in asks]
        right = [_right(t) for t in trials]
        tell_misses(trials, right)
        figures += [
            share(
                f"out of the library, d = {d:g}: unknown or incomplete, right covariate",
                right,
                partial(at_least, goal=goal),
            ),
            share("  unknown, or incomplete", [_open(t) for t in trials]),
            share(
                "  a cause of the library named with certainty",
                [t.verdict == "named" and t.probability >= 0.9 for t in trials],
                lambda p: at_most(p, CERTAIN),
            ),
        ]
    known = [s.trial for d in NAMING for s in survey(seed, sets, d)]
    figures.append(
        share(
            "known, d = 8, 11, 16: called unknown", [t.verdict == "unknown" for t in known], lambda p: at_most(p, 0.02)
        )
    )
    figures.append(share("  called incomplete", [t.verdict == "incomplete" for t in known]))
    return figures


def _open(t: Trial) -> bool:
    return t.verdict in ("unknown", "incomplete")


def _right(t: Trial) -> bool:
    return _open(t) and bool(set(t.words) & OUTSIDE[t.request.name][0])
