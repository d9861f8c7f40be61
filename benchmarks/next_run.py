"""Reliability of the next run: how often it leaves a single cause, beside the chance it promised.

A cause hides in tilts or faces, at a strength drawn from 5 to 16, in a white or in a full floor; where the diagnosis
ends in a tie two things are measured by the same independent bench and diagnosed again: all that is proposed, and one
run of the menu whose promise is nearest to a chance that is drawn, so that small promises are tried, too.

    python benchmarks/next_run.py [--sets 100] [--seed 1] [--ties FILE] [--picture docs/pictures/next-run.svg]

With --ties each tie is added to a file, one JSON list a line, and the figures are those of all in it.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from diagnosis_rows.figures import Array, Figure, at_least, at_most, share
from diagnosis_rows.ties import Parted, Tied, proposed, tied

from station.diagnosis.planning.measured import measured_campaign
from station.diagnosis.planning.next_run import ties_of
from station.diagnosis.planning.proposal import promised, rated_runs
from station.diagnosis.search.null_simulation import NULL_SETS
from station.domain.recipe.recipe import Recipe
from station.reporting.drawing.figure import Figure as Picture
from station.reporting.drawing.figure import Series, svg
from tests.blind import inspection
from tests.blind.bench import FULL, WHITE
from tests.blind.recipes import recipe, six_faces

#: Edges of the promised chance in the diagram; the weakest and the strongest that is hidden.
EDGES, WEAKEST, STRONGEST = (0.0, 0.25, 0.5, 0.75, 0.9, 1.01), 5.0, 16.0
#: What each layout hides, where each looks like another.
SLOW = ("bias-drift", "offset-temperature", "warm-up", "clamp-creep", "temperature-rate")
TURNED = ("nest-tilt", "package-rotation", "index-error")
LAYOUTS: tuple[tuple[str, Recipe, int, tuple[str, ...]], ...] = (
    ("tilts once, 4 units", recipe(1), 4, (*SLOW, *TURNED)),
    ("tilts once, 1 unit", recipe(1), 1, (*SLOW, *TURNED)),
    ("tilts twice, 2 units", recipe(2), 2, (*SLOW, *TURNED, "gain-temperature")),
    ("faces once, 4 units", six_faces("listed"), 4, (*SLOW, *TURNED)),
    ("faces twice, 2 units", six_faces("listed", "reversed"), 2, (*SLOW, *TURNED, "gain-temperature", "asymmetry")),
)


def measure(seed: int, sets: int) -> Iterator[tuple[Parted, Parted | None]]:
    """Of every tie among so many hidden data sets what was proposed, and one run of the menu; with what each promised
    and reached."""
    rng = np.random.default_rng([seed, 12])
    for n in range(sets):
        title, of, units, names = LAYOUTS[n % len(LAYOUTS)]
        name = str(rng.choice(names))
        d = float(np.exp(rng.uniform(np.log(WEAKEST), np.log(STRONGEST))))
        floor, wanted = (FULL if rng.random() < 1 / 3 else WHITE), float(rng.uniform())
        first = tied(name, seed * 10**6 + 970_000 + 7 * n, d, of, units, floor)
        if first is not None:
            best, drawn = proposed(first), of_the_menu(first, wanted)
            shown = " | ".join(f"{p.promised:.2f}, {p.resolved}, {p.change}" for p in (best, drawn) if p is not None)
            print(f"    {title}, {name}, d = {d:.1f}, {'/'.join(first.before)}: {shown}", flush=True)
            yield best, drawn


def of_the_menu(first: Tied, wanted: float) -> Parted | None:
    """The run of the menu whose bound is nearest to a chance; None where none promises anything."""
    ties, campaign = ties_of(first.found), measured_campaign(first.found)
    rated = [p for p in rated_runs(campaign, ties) if p.certainty > 0.01] if ties else []
    nearest = min(rated, key=lambda p: abs(p.certainty - wanted), default=None)
    return None if nearest is None else first.after(promised(campaign, nearest, ties))


def figures(ties: Sequence[tuple[Parted, Parted | None]]) -> list[Figure]:
    """The share reached, the mean promise less it, and the diagram's rows."""
    best = [t for t, _ in ties]
    both = [t for tie in ties for t in tie if t is not None and t.proposed]
    mean = gap("promised − reached, all that is proposed", [t for t in best if t.proposed])
    rows = [
        share("a single cause, the right one, is left", [t.resolved for t in best], lambda p: at_least(p, 0.90)),
        share("  of those where a run is proposed", [t.resolved for t in best if t.proposed]),
        mean,
        gap("  … and the runs of the menu that were drawn", both),
    ]
    for low, high in pairwise(EDGES):
        if chosen := _between(both, low, high):
            promised = float(np.mean([t.promised for t in chosen]))
            words = f"  promised {low:.2f} to {min(high, 1.0):.2f}, mean {promised:.2f}: reached"
            rows.append(share(words, [t.resolved for t in chosen]))
    return [*rows, calibration_error(both)]


def gap(what: str, ties: Sequence[Parted]) -> Figure:
    """The mean promise less what was reached."""
    each = np.array([t.promised - t.resolved for t in ties] or [np.nan])
    mean, error = float(each.mean()), float(np.std(each, ddof=1) / np.sqrt(len(each))) if len(each) > 1 else np.inf
    return Figure(what, mean, mean - 1.96 * error, mean + 1.96 * error, len(each), *at_most(mean, 0.05))


def calibration_error(ties: Sequence[Parted]) -> Figure:
    """The mean distance of what is reached from what was promised over the diagram's classes, each weighted by its
    ties; what chance alone makes of it, were every promise true, as the interval."""
    promised = np.array([t.promised for t in ties])
    reached = np.array([float(t.resolved) for t in ties])
    rng = np.random.default_rng(1)
    chance = [_error(promised, rng.random(len(promised)) < promised) for _ in range(2000)]
    low, high = np.quantile(chance, [0.025, 0.975])
    value = _error(promised, reached)
    return Figure("mean calibration error (interval: by chance)", value, float(low), float(high), len(ties))


def _error(promised: Array, reached: Array) -> float:
    place = np.digitize(promised, EDGES)
    return sum(abs(float(np.sum((promised - reached)[place == k]))) for k in np.unique(place)) / len(promised)


def _between(ties: Sequence[Parted], low: float, high: float) -> list[Parted]:
    return [t for t in ties if low <= t.promised < high]


def drawn(ties: Sequence[tuple[Parted, Parted | None]]) -> str:
    """The diagram as one SVG: reached against promised, with Wilson's intervals, and where they are the same."""
    both = [t for tie in ties for t in tie if t is not None and t.proposed]
    classes = [c for low, high in pairwise(EDGES) if (c := _between(both, low, high))]
    shares = [share("", [t.resolved for t in c]) for c in classes]
    points = Series(
        [float(np.mean([t.promised for t in c])) for c in classes],
        [s.value for s in shares],
        f"reached, {len(both)} runs after {len(ties)} ties, with its 95 % interval",
        low=[s.low for s in shares],
        high=[s.high for s in shares],
    )
    same = Series([0.0, 1.0], [0.0, 1.0], "as promised", kind="line", colour=5)
    title = "Next run: chance reached against chance promised"
    return svg(Picture(title, "chance promised", "share that left the right cause alone", (same, points)))


def stored(path: Path) -> list[tuple[Parted, Parted | None]]:
    """Every tie that was kept."""
    if not path.exists():
        return []
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return [(_parted(best), _parted(drawn) if drawn else None) for best, drawn in lines]


def _parted(kept: dict[str, Any]) -> Parted:
    return Parted(kept["name"], tuple(kept["before"]), tuple(kept["after"]), kept["promised"], kept["change"])


def main() -> int:
    """Prints the diagram; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sets", type=int, default=100, help="data sets in which a cause is hidden")
    parser.add_argument("--null-sets", type=int, default=NULL_SETS, help="null sets of each kind of campaign")
    parser.add_argument("--ties", type=Path, help="file that keeps the ties")
    parser.add_argument("--picture", type=Path, help="SVG file for the diagram")
    requested = parser.parse_args()
    inspection.SETS = requested.null_sets
    begun = time.process_time()
    ties = stored(requested.ties) if requested.ties else []
    for tie in measure(requested.seed, requested.sets):
        ties.append(tie)
        if requested.ties:
            with requested.ties.open("a", encoding="utf-8") as file:
                file.write(json.dumps([t and asdict(t) for t in tie]) + "\n")
    rows = figures(ties)
    for row in rows:
        print(row.line())
    if requested.picture:
        requested.picture.write_text(drawn(ties), encoding="utf-8")
    print(f"seed {requested.seed}, {time.process_time() - begun:.0f} s of processor")
    return int(any(row.met is False for row in rows))


if __name__ == "__main__":
    sys.exit(main())
