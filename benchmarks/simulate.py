"""How fast the forward simulation is: seconds for a campaign, growth with the fleet, and peak memory of a big one.

python benchmarks/simulate.py [--runs 7] [--units 200]

The limit it is held against is what cannot be left out: drawing the same samples' noise and writing it once.
"""

import argparse
import resource
import statistics
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from station import plugins
from station.config.recipes import load_recipe
from station.model.simulate import SimulationJob, parse_effect, simulate, simulate_in_parts

GOAL_S = 0.1


def timed(work: Callable[[], object], runs: int) -> list[float]:
    """Seconds of each run, the first one left out."""
    seconds = []
    for _ in range(runs + 1):
        begun = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - begun)
    return seconds[1:]


def shown(what: str, seconds: list[float], limit_s: float, goal: str) -> None:
    """One line: median, spread, ratio to the limit, goal."""
    low, middle, high = min(seconds), statistics.median(seconds), max(seconds)
    ratio = f"{middle / limit_s:.1f} × the noise alone"
    print(
        f"{what:<44} {middle * 1e3:8.1f} ms  ({low * 1e3:.1f} … {high * 1e3:.1f}, n = {len(seconds)})  {ratio}  {goal}"
    )


def main() -> None:
    """Prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--units", type=int, default=200)
    options = parser.parse_args()
    recipe = load_recipe("tilt-24")
    four = tuple(f"SN{i:04d}" for i in range(4))
    everything = tuple(parse_effect(name, recipe) for name in plugins.names("station.model.effects"))
    samples = len(simulate(SimulationJob(recipe, four, 1)).table)
    rng = np.random.default_rng(1)
    limit_s = statistics.median(timed(lambda: rng.standard_normal((samples, 3)).copy(), options.runs))
    for what, effects in (("no cause", ()), (f"all {len(everything)} causes", everything)):
        job = SimulationJob(recipe, four, 1, effects)
        seconds = timed(partial(simulate, job), options.runs)
        shown(f"{samples} samples, {what}", seconds, limit_s, f"goal ≤ {GOAL_S * 1e3:.0f} ms")
    fleet = SimulationJob(recipe, tuple(f"SN{i:04d}" for i in range(options.units)), 1)
    begun = time.perf_counter()
    rows = sum(len(part.table) for part in simulate_in_parts(fleet))
    spent = time.perf_counter() - begun
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{rows} samples of {options.units} units in parts: {spent:.2f} s, {rows / spent / 1e6:.2f} million a second")
    print(f"peak memory {peak:.0f} MiB, goal ≤ 700 MiB whatever the fleet")


if __name__ == "__main__":
    main()
