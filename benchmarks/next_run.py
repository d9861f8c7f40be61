"""Reliability of the next run: how often it leaves a single cause, beside the chance it promised.

A cause hides in one run of 24 tilts at several strengths; where the diagnosis ends in a tie the proposed runs are made
by the same independent bench and everything is diagnosed again. `python benchmarks/next_run.py --sets 2 --seed 1`.
"""

import argparse
import sys
import time
from itertools import pairwise

import numpy as np
from diagnosis_rows.figures import Figure, at_least, at_most, share
from diagnosis_rows.ties import TIED_ONCE, Parted, parted

from station.diagnosis.search.null_simulation import NULL_SETS
from tests.blind import inspection

#: Edges of the promised chance in the diagram, strengths that are hidden.
EDGES, STRENGTHS = (0.0, 0.25, 0.5, 0.75, 0.9, 1.01), (8.0, 12.0, 16.0)


def measure(seed: int, sets: int) -> list[Parted]:
    """Every tie among the hidden data sets, with what its next run promised and reached."""
    found = []
    for i, name in enumerate(TIED_ONCE):
        for k, d in enumerate(STRENGTHS):
            for n in range(sets):
                one = parted(name, seed * 10**6 + 970_000 + 1000 * i + 100 * k + n, d)
                if one is not None:
                    print(f"    {name}, d = {d:g}: promised {one.promised:.2f}, reached {one.resolved}", flush=True)
                    found.append(one)
    return found


def figures(ties: list[Parted]) -> list[Figure]:
    """The share reached, the mean promise less it, and the diagram's rows."""
    promised = np.array([t.promised for t in ties])
    reached = np.array([t.resolved for t in ties], float)
    gap = promised - reached
    error = float(np.std(gap, ddof=1) / np.sqrt(len(gap))) if len(gap) > 1 else float("inf")
    mean = float(gap.mean())
    rows = [
        share("a single cause, the right one, is left", [t.resolved for t in ties], lambda p: at_least(p, 0.90)),
        Figure("promised − reached", mean, mean - 1.96 * error, mean + 1.96 * error, len(ties), *at_most(mean, 0.05)),
    ]
    for low, high in pairwise(EDGES):
        chosen = [t.resolved for t in ties if low <= t.promised < high]
        if chosen:
            rows.append(share(f"  promised {low:.2f} to {min(high, 1.0):.2f}: reached", chosen))
    return rows


def main() -> int:
    """Prints the diagram; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sets", type=int, default=2, help="data sets of each cause and strength")
    requested = parser.parse_args()
    inspection.SETS = NULL_SETS
    begun = time.process_time()
    rows = figures(measure(requested.seed, requested.sets))
    for row in rows:
        print(row.line())
    print(f"seed {requested.seed}, {time.process_time() - begun:.0f} s of processor")
    return int(any(row.met is False for row in rows))


if __name__ == "__main__":
    sys.exit(main())
