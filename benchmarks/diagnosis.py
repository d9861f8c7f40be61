"""How good the diagnosis is: alarms, names, sets, unknowns, gains, sizes, next runs and cost, with 95 % intervals.

    python benchmarks/diagnosis.py [--rows naming,false-alarms] [--sets 1] [--seed 1] [--json FILE]

Everything but the cost is measured on samples made by the blind tests' own bench (tests/blind), which shares no line
with the bank: 24 tilts, three varied runs, four units, 25 samples a second, strength set by d. --sets multiplies the
data sets: 1 takes about a quarter of an hour on one core. Below a row stands what was missed, with its seed.
The peers need the `bench` group.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

from diagnosis_rows.cost import cost
from diagnosis_rows.detection import false_alarms, power
from diagnosis_rows.figures import Figure
from diagnosis_rows.intervals import coverage
from diagnosis_rows.long_runs import long_runs
from diagnosis_rows.many_units import many_units
from diagnosis_rows.naming import gain, naming, set_size, sizes
from diagnosis_rows.pairs import two
from diagnosis_rows.ties import degenerate, resolved
from diagnosis_rows.unknown import unknown

from station.diagnosis.search.null_simulation import NULL_SETS
from tests.blind import inspection

ROWS: dict[str, Callable[[int, int], list[Figure]]] = {
    "false-alarms": false_alarms,
    "power": power,
    "naming": naming,
    "sizes": sizes,
    "degenerate": degenerate,
    "unknown": unknown,
    "gain": gain,
    "two": two,
    "coverage": coverage,
    "set-size": set_size,
    "next-run": resolved,
    "cost": cost,
    "long-runs": lambda seed, _: long_runs(seed),
    "many-units": lambda seed, _: many_units(seed),
}


def main() -> int:
    """Prints every row asked for; 1 where a goal was missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", default=",".join(ROWS), help="some of: %(default)s")
    parser.add_argument("--sets", type=int, default=1, help="multiplies the data sets")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    requested = parser.parse_args()
    chosen = requested.rows.split(",")
    if not set(chosen) <= set(ROWS):
        parser.error(f"--rows knows {', '.join(ROWS)}")
    # As many as the product draws: a threshold from fewer lies higher.
    inspection.SETS = NULL_SETS
    shown: dict[str, list[Figure]] = {}
    for name in chosen:
        begun = time.process_time()
        print(f"{name}, seed {requested.seed}, sets {requested.sets}", flush=True)
        shown[name] = ROWS[name](requested.seed, requested.sets)
        for figure in shown[name]:
            print(figure.line())
        print(f"  ({time.process_time() - begun:.0f} s of processor)\n", flush=True)
        if requested.json:
            figures = {name: [f.document() for f in row] for name, row in shown.items()}
            requested.json.write_text(
                json.dumps({"seed": requested.seed, "sets": requested.sets, "rows": figures}, indent=1)
            )
    return int(any(f.met is False for row in shown.values() for f in row))


if __name__ == "__main__":
    sys.exit(main())
