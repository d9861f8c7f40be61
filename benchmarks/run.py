"""How soon the command line answers, and how long four simulated units take from an empty folder to their verdicts.

    python benchmarks/run.py [--times 5]

Help: `station --help` less `python -c pass`; goal 0.15 s. Run: wall time of `station run --simulate --units 4`, six
positions and two more for verification, with the start of Python in it; goal 3 s.
"""

import argparse
import statistics
import subprocess
import sys
import tempfile
import time


def lasts_s(command: list[str], folder: str) -> float:
    """Wall time of a command, s."""
    begin = time.perf_counter()
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return time.perf_counter() - begin


def main() -> None:
    """Prints figure, goal and spread."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--times", type=int, default=5)
    times = options.parse_args().times
    python, station = [sys.executable, "-c", "pass"], [sys.executable, "-m", "station"]
    bare, helps, runs = [], [], []
    for _ in range(times):
        with tempfile.TemporaryDirectory() as folder:
            bare.append(lasts_s(python, folder))
            helps.append(lasts_s([*station, "--help"], folder))
            runs.append(lasts_s([*station, "run", "--simulate", "--units", "4"], folder))
    extra = [h - b for h, b in zip(helps, bare, strict=True)]
    _tell("station --help, more than python itself", extra, 0.15)
    _tell("station run --simulate --units 4", runs, 3.0)


def _tell(what: str, found: list[float], goal_s: float) -> None:
    middle = statistics.median(found)
    spread = f"{min(found):.3f} to {max(found):.3f} s in {len(found)} runs"
    print(f"{what}: {middle:.3f} s ({spread}), goal {goal_s:g} s: {'met' if middle <= goal_s else 'MISSED'}")


if __name__ == "__main__":
    main()
