"""How soon the command line answers, and how soon `station run` has its first frames decoded.

    python benchmarks/startup.py [--times 7] [--profile]

Row 12. Help: `station --help` less `python -c pass`; goal 0.15 s. First frames: from the start of the process until
`station run --simulate --units 4` has decoded and shown the first readings of its first dwell (files read and checked,
log opened, devices identified and made ready, one settling in simulated time); goal 1 s. Wall time, and beside it
the processor's time of the same runs, which a busy machine does not stretch as much. --profile: where imports go.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time

import figures

#: The command itself; it says when its first event with readings is shown, and ends.
FIRST_FRAMES = """
import os, sys, time
import station.panel_protocol.live_state as live
from station.cli.app import main
from station.domain.run.progress import Reading
shown = live.Live.event
def event(self, happened):
    shown(self, happened)
    if isinstance(happened, Reading):
        heavy = sorted({"asammdf", "pandas", "pyarrow", "matplotlib"} & set(sys.modules))
        print(time.time(), *heavy, flush=True)
        os._exit(0)
live.Live.event = event
main(["run", "--simulate", "--units", "4"])
"""
#: As a user's Python is: compiled modules are kept.
SURROUNDINGS = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}


def lasts(command: list[str]) -> tuple[float, float, list[str]]:
    """Wall and processor time, s, of a command; it may print when it was ready and what it should not have loaded."""
    with tempfile.TemporaryDirectory() as folder:
        before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.time()
        printed = subprocess.run(
            command, cwd=folder, env=SURROUNDINGS, check=True, capture_output=True, text=True
        ).stdout.split()
        end, after = time.time(), resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    timed = bool(printed) and printed[0].replace(".", "").isdigit()
    return (float(printed[0]) if timed else end) - begin, used, printed[1:] if timed else []


def main() -> None:
    """Prints figure, goal and spread."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--times", type=int, default=7)
    options.add_argument("--profile", action="store_true")
    given = options.parse_args()
    if given.profile:
        _profile()
        return
    lasts([sys.executable, "-c", FIRST_FRAMES])  # compiles what has changed since
    bare, helps, firsts = [], [], []
    for _ in range(given.times):
        bare.append(lasts([sys.executable, "-c", "pass"]))
        helps.append(lasts([sys.executable, "-m", "station", "--help"]))
        firsts.append(lasts([sys.executable, "-c", FIRST_FRAMES]))
    heavy = sorted({name for _, _, names in firsts for name in names})
    print(f"python {sys.version.split()[0]}, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    beyond = [(h[0] - b[0], h[1] - b[1]) for h, b in zip(helps, bare, strict=True)]
    _tell("station --help beyond python -c pass", beyond, 0.15)
    _tell("station run to its first frames decoded", [(wall, used) for wall, used, _ in firsts], 1.0)
    print(f"loaded although not needed: {', '.join(heavy) or 'nothing'}")


def _tell(what: str, found: list[tuple[float, float]], goal_s: float) -> None:
    walls, used = sorted(wall for wall, _ in found), statistics.median(u for _, u in found)
    middle = statistics.median(walls)
    reached = middle <= goal_s
    figures.keep(12, what, figures.spread(walls, " s"), f"processor {used:.2f} s", f"<= {goal_s:g} s", reached)
    spread = f"{walls[0]:.3f} to {walls[-1]:.3f} s in {len(walls)} runs; processor {used:.3f} s"
    print(f"{what}: {middle:.3f} s ({spread}), goal {goal_s:g} s: {'met' if middle <= goal_s else 'MISSED'}")


def _profile() -> None:
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-X", "importtime", "-c", FIRST_FRAMES]
        shown = subprocess.run(command, cwd=folder, env=SURROUNDINGS, check=True, capture_output=True, text=True).stderr
    rows = [line.removeprefix("import time:").split("|") for line in shown.splitlines()[1:] if line.count("|") == 2]
    for own, whole, name in sorted(rows, key=lambda row: -int(row[1]))[:40]:
        print(f"{int(whole) / 1000:8.1f} ms, itself {int(own) / 1000:7.1f} ms  {name.strip()}")


if __name__ == "__main__":
    main()
