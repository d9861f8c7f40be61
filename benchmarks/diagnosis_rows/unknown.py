"""Row 6: what no cause of the library explains is called unknown, and what is known is not."""

from benchmarks.diagnosis_rows.figures import Figure, at_least, at_most, share
from benchmarks.diagnosis_rows.naming import NAMING, survey
from benchmarks.diagnosis_rows.trials import Ask, Trial, tell_misses, trial
from tests.blind.hidden import UNKNOWN

RECALL = {11.0: 0.75, 16.0: 0.90}


def unknown(seed: int, sets: int) -> list[Figure]:
    """Row 6."""
    figures = []
    for d, goal in RECALL.items():
        asks = [
            Ask(name, "white", seed * 10**6 + 600_000 + 1000 * round(d) + 10 * n + i, d=d)
            for i, name in enumerate(sorted(UNKNOWN))
            for n in range(2 * sets)
        ]
        trials = [trial(a) for a in asks]
        called = [t.verdict == "unknown" for t in trials]
        tell_misses(trials, called)
        recognised = [t for t, good in zip(trials, called, strict=True) if good]
        figures += [
            share(f"out of the library, d = {d:g}: called unknown", called, lambda p, goal=goal: at_least(p, goal)),
            share("  unknown, or incomplete", [t.verdict in ("unknown", "incomplete") for t in trials]),
            share("  with the right covariate", [_right(t) for t in recognised], lambda p: at_least(p, 0.90)),
        ]
    known = [s.trial for d in NAMING for s in survey(seed, sets, d)]
    figures.append(
        share(
            "known, d = 8, 11, 16: called unknown", [t.verdict == "unknown" for t in known], lambda p: at_most(p, 0.02)
        )
    )
    figures.append(share("  called incomplete", [t.verdict == "incomplete" for t in known]))
    return figures


def _right(t: Trial) -> bool:
    return bool(set(t.words) & UNKNOWN[t.ask.name][0])
