"""Stop, pressed 1 to 20 times from random instants of a run on: parked, put back, every record finished and true.

    python tests/endurance/torture_stops.py [--instants 500] [--seed 1] [--json]

Instants are the calls of devices, positioner and log, and the sleeps inside moves and parking; the signals are real.
"""

import argparse
import contextlib
import io
import json
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from tests.fakes.fixture_run import brief_recipe
from tests.fakes.stop_presses import faults_of, run_and_press


def main() -> int:
    """Prints the count; 1 when a stop left something as it must not be."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--instants", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    _die_of_sigterm()
    begun_s = time.monotonic()
    rng = np.random.default_rng(given.seed)
    calls = _calls()
    wrong: list[str] = []
    for number in range(given.instants):
        at, presses = int(rng.integers(0, calls)), int(rng.integers(1, 21))
        with tempfile.TemporaryDirectory() as folder, _silent():
            code, pressing = run_and_press(Path(folder), at, presses, recipe=brief_recipe(Path(folder)))
            found = faults_of(Path(folder), code, pressing)
        wrong += [f"{number}: {presses} presses from call {at} on: {fault}" for fault in found]
    right = given.instants - len({w.partition(":")[0] for w in wrong})
    if given.json:
        print(json.dumps({"instants": given.instants, "right": right, "said": wrong}))
    else:
        print(f"stops: {right} of {given.instants} parked, put back, finished (seed {given.seed})   goal: all of 500")
        print(f"  {time.monotonic() - begun_s:.0f} s, {calls} instants a run")
        for line in wrong:
            print(f"  {line}")
    return int(bool(wrong))


def _calls() -> int:
    """How many instants a run without a stop has."""
    with tempfile.TemporaryDirectory() as folder, _silent():
        return run_and_press(Path(folder), 1 << 30, 0, recipe=brief_recipe(Path(folder)))[1].calls


def _die_of_sigterm() -> None:
    """Runs take SIGTERM for a stop and go on parking; whoever ends this script (`timeout`) means all of it."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})

    def wait() -> None:
        signal.sigwait({signal.SIGTERM})
        os._exit(128 + signal.SIGTERM)

    threading.Thread(target=wait, daemon=True).start()


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield


if __name__ == "__main__":
    sys.exit(main())
