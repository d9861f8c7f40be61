"""Row 12: how long the whole command takes, and how its cost grows with the units."""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from diagnosis_rows.figures import Figure, Judge, at_most

from tests.blind.bench import hide
from tests.blind.hidden import KNOWN
from tests.blind.inspection import diagnosis_of
from tests.blind.recipes import recipe

UNITS = (4, 16, 64)
TIMES = 3
#: The command in one process, twice: the second time everything is imported.
TWICE = """
import sys, time, json
from contextlib import suppress
from station.cli.app import main
for _ in range(2):
    wall, cpu = time.perf_counter(), time.process_time()
    with suppress(SystemExit):
        main(["diagnose", "--samples", sys.argv[1], "--recipe", "tilt-24", "--json", sys.argv[2]])
    last = time.perf_counter() - wall, time.process_time() - cpu
print(json.dumps(last))
"""
#: As a user's Python is: compiled modules are kept.
SURROUNDINGS = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}


def cost(_seed: int, sets: int) -> list[Figure]:
    """Row 12."""
    with tempfile.TemporaryDirectory() as folder:
        samples, out = Path(folder) / "samples.parquet", Path(folder) / "found.json"
        station = [sys.executable, "-m", "station"]
        _run([*station, "simulate", "--recipe", "tilt-24", "--units", "4", "--effect", "quadratic",
              "--out", str(samples)], folder)  # fmt: skip
        diagnose = [*station, "diagnose", "--samples", str(samples), "--recipe", "tilt-24", "--json", str(out)]
        cold = [_run(diagnose, f"{folder}/{n}") for n in range(TIMES)]
        warm = [_run(diagnose, f"{folder}/0") for _ in range(TIMES)]
        twice = [sys.executable, "-c", TWICE, str(samples), str(out)]
        again = [json.loads(_printed(twice, f"{folder}/0").splitlines()[-1]) for _ in range(TIMES)]
    figures = _pair("28,800 samples, command, cold cache", cold, None)
    figures += _pair("28,800 samples, command, warm cache", warm, lambda s: at_most(s, 3.0))
    figures += _pair("  of it besides imports", [(a, b) for a, b in again], lambda s: at_most(s, 0.5))
    return [*figures, grows(sets)]


def _pair(what: str, times: list[tuple[float, float]], judge: Judge | None) -> list[Figure]:
    """Median of wall time, the processor's beside it."""
    wall, cpu = (np.array([t[i] for t in times]) for i in (0, 1))
    value = float(np.median(wall))
    goal, met = judge(value) if judge is not None else ("", None)
    note = f"s; {np.median(cpu):.2f} s of processor"
    return [Figure(what, value, float(wall.min()), float(wall.max()), len(wall), goal, met, note)]


def _run(command: list[str], cache: str) -> tuple[float, float]:
    """Wall and processor time of a command, s."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    _printed(command, cache)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - begun, used


def _printed(command: list[str], cache: str) -> str:
    """What a command prints; exit code 1 is a finding."""
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env={**SURROUNDINGS, "XDG_CACHE_HOME": cache}
    )
    if done.returncode not in (0, 1):
        raise SystemExit(f"{' '.join(command)} broke off: {done.stderr[-2000:]}")
    return done.stdout


def grows(sets: int) -> Figure:
    """The power of the number of units that the processor's time follows, nulls kept."""
    spent = []
    most = UNITS if sets < 4 else (*UNITS, 256)
    for units in most:
        table, _ = hide(recipe(), KNOWN["quadratic"], 1, units=units)
        diagnosis_of(recipe(), table)
        begun = time.process_time()
        diagnosis_of(recipe(), table)
        spent.append(time.process_time() - begun)
        print(f"    {units} units, {len(table)} samples: {spent[-1]:.2f} s of processor", flush=True)
    slope = [float(np.log(b / a) / np.log(n / m)) for a, b, m, n in zip(spent, spent[1:], most, most[1:], strict=False)]
    goal, met = at_most(slope[-1], 1.1)
    note = f"t ∝ unitsᵖ, {most[-2]}–{most[-1]} units"
    return Figure("cost against units, p", slope[-1], min(slope), max(slope), len(most), goal, met, note)
