"""Somebody else at the bench at random instants: foreign writes, resets, stops, swapped units; no PASS may follow.

    python tests/endurance/torture_intruder.py [--instants 1000] [--seed 1] [--json]

Instants are the calls of the device and of the log, from the first to the last before the verdict.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from station.domain.core.types import Outcome
from tests.fakes.fixture_run import Ran, brief_recipe
from tests.fakes.intruder import ACTIONS, SERIAL, Intruder


def main() -> int:
    """Prints the count; 1 when a disturbed unit passed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--instants", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    calls = _calls()
    passed: list[str] = []
    begun_s = time.monotonic()
    for number in range(given.instants):
        at, deed = int(rng.integers(0, calls)), list(ACTIONS)[number % len(ACTIONS)]
        results = _disturbed(Intruder(ACTIONS[deed], at)).results
        if SERIAL in results and results[SERIAL].outcome is Outcome.PASS:
            passed.append(f"{number}: {deed} before call {at} of {calls}")
    found = given.instants - len(passed)
    if given.json:
        print(json.dumps({"instants": given.instants, "found": found, "said": passed}))
    else:
        print(f"intruder: {found} of {given.instants} found before PASS (seed {given.seed})   goal: all of 1000")
        print(f"  {time.monotonic() - begun_s:.0f} s, {calls} instants a run")
        for line in passed:
            print(f"  {line}")
    return int(bool(passed))


def _calls() -> int:
    """How many instants a run has that nobody disturbs."""
    alone = Intruder(lambda _bench, _seat: None, 1 << 30)
    assert _disturbed(alone).results[SERIAL].outcome is Outcome.PASS
    return alone.calls


def _disturbed(intruder: Intruder) -> Ran:
    with tempfile.TemporaryDirectory() as folder:
        return intruder.run(Path(folder), recipe=brief_recipe(Path(folder)))


if __name__ == "__main__":
    sys.exit(main())
