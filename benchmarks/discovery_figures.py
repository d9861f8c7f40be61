"""The table of the formulas' goals from the outcomes of campaigns, each share with Wilson's 95 % interval."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence

import figures
import numpy as np
from diagnosis_rows.figures import Figure, Judge, at_least, at_most, bootstrapped, share
from discovery_trials import Outcome

#: Share of the right family and of the true law's gain that a strength must reach.
GOALS = {11.0: (0.80, 0.90), 16.0: (0.88, 0.95), 32.0: (0.94, 0.95)}
#: A formula that follows the law as closely as these data can show is no invention; length in white data.
INVENTED = 3.3
#: How many formulas that are not the law are listed for each strength.
MOST_LISTED = 12


def print_table(outcomes: Sequence[Outcome]) -> None:
    """Prints every figure that the outcomes bear, and which laws were taken for another."""
    for figure in _figures(outcomes):
        print(figure.line(), flush=True)
        interval = f"{figure.value:.3f} ({figure.low:.3g} to {figure.high:.3g})"
        figures.keep(19, figure.what, interval, "", figure.goal, figure.met is not False)
    for d in GOALS:
        wrong = [o for o in _of(outcomes, "laws", d) if o.found and not o.right]
        for (law, found), n in Counter((o.law, " + ".join(o.found)) for o in wrong).most_common(MOST_LISTED):
            print(f"      d {d:g}: {law} -> {found} ({n})")


def _figures(outcomes: Sequence[Outcome]) -> Iterator[Figure]:
    for d in GOALS:
        yield from _single(d, _of(outcomes, "laws", d))
    yield from _double(_of(outcomes, "two terms"))
    yield from _strange(_of(outcomes, "not expressible"))
    if nulls := _of(outcomes, "nulls"):
        yield share("false alarms of the whole search", [bool(o.found) for o in nulls], _at_most(0.015))
    if again := _of(outcomes, "library"):
        missed = ", ".join(f"{o.law} -> {' + '.join(o.found)}" for o in again if not o.right)
        yield share("library causes at their usual size, found again", [o.right for o in again], _at_least(0.9), missed)
    for d in GOALS:
        yield from _whole(d, _of(outcomes, "whole", d))
        yield from _against_rivals(d, _of(outcomes, "rivals", d))
    if searches := _of(outcomes, "laws"):
        yield _middle("processor time of a search, s", [o.seconds for o in searches], _at_most(5.0))


def _of(outcomes: Sequence[Outcome], part: str, d: float | None = None) -> list[Outcome]:
    return [o for o in outcomes if o.part == part and d in (None, o.d)]


def _single(d: float, trials: Sequence[Outcome]) -> Iterator[Figure]:
    shown = [o for o in trials if o.found]
    if not shown:
        return
    family, gain = GOALS[d]
    yield share(f"d {d:g}: a formula proposed", [bool(o.found) for o in trials])
    yield share(f"d {d:g}: right family, given detection", [o.right for o in shown], _at_least(family))
    yield share(f"d {d:g}: |cos| > .95 to the law", [o.cosine > 0.95 for o in shown])
    yield share(f"d {d:g}: set covers the law", [o.covers for o in shown], _at_least(0.93))
    yield _middle(f"d {d:g}: median size of the set", [o.alternatives for o in shown], _at_most(2.0))
    note = f"mean {np.mean([o.gain for o in shown]):.3f}"
    yield _middle(f"d {d:g}: held-out gain over the law's, median", [o.gain for o in shown], _at_least(gain), note)
    yield share(f"d {d:g}: negative held-out gain", [o.gain < 0 for o in shown], _at_most(0.01))
    yield share(f"d {d:g}: the right formula called complete", [o.quiet for o in shown if o.right])
    yield share(f"d {d:g}: a second term beside the right one", [len(o.found) > 1 for o in shown if o.right])


def _double(trials: Sequence[Outcome]) -> Iterator[Figure]:
    shown = [o for o in trials if o.found]
    if shown:
        yield share(f"two terms, d {shown[0].d:g}: both in the set", [o.covers for o in shown])


def _strange(trials: Sequence[Outcome]) -> Iterator[Figure]:
    # What a formula follows so that no data at these visits could tell is expressible here.
    strange = [o for o in trials if not o.right]
    if not strange:
        return
    certain = [bool(o.found) and o.quiet for o in strange]
    kinds = str(dict(Counter(o.law for o, sure in zip(strange, certain, strict=True) if sure)))
    note = f"{kinds}; {len(trials) - len(strange)} more are a formula at these visits"
    yield share("not expressible: no formula, or incomplete", [not sure for sure in certain], _at_least(0.9), note)
    invented = [sure and o.missed > INVENTED for o, sure in zip(strange, certain, strict=True)]
    as_measured = sum(sure and o.missed_as_measured > INVENTED for o, sure in zip(strange, certain, strict=True))
    note = f"{as_measured} if the errors of thermometer and meter count, too"
    yield share("not expressible: a wrong formula with certainty", invented, _at_most(0.02), note)


def _whole(d: float, trials: Sequence[Outcome]) -> Iterator[Figure]:
    shown = [o.verdict for o in trials if o.verdict != "none"]
    if not shown:
        return
    counts = str(dict(Counter(o.verdict for o in trials)))
    yield share(f"d {d:g}: whole diagnosis, right", [v == "right" for v in shown], _at_least(0.93), counts)
    named = [v.startswith("named") for v in shown]
    note = f"{shown.count('named')} of them for certain"
    yield share(f"d {d:g}: whole diagnosis, named as a cause", named, _at_most(0.03), note)


def _against_rivals(d: float, trials: Sequence[Outcome]) -> Iterator[Figure]:
    if not trials:
        return
    names = sorted({name for o in trials for name in o.rivals})
    theirs = [
        share(f"d {d:g}: {name}, |cos| > .95 to the law", [o.rivals[name] > 0.95 for o in trials if name in o.rivals])
        for name in names
    ]
    yield from theirs
    best = max((f.value for f in theirs), default=0.0)
    yield share(f"d {d:g}: |cos| > .95 to the law, same data", [o.cosine > 0.95 for o in trials], _at_least(best + 0.1))


def _middle(what: str, values: Sequence[float], judge: Judge, note: str = "") -> Figure:
    each = np.asarray(values, float)
    return bootstrapped(what, lambda rows: float(np.median(each[rows])), len(each), judge, note)


def _at_least(goal: float) -> Callable[[float], tuple[str, bool]]:
    return lambda value: at_least(value, goal)


def _at_most(goal: float) -> Callable[[float], tuple[str, bool]]:
    return lambda value: at_most(value, goal)
