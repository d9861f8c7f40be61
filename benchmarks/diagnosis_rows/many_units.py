"""What the whole command costs where a table holds very many units: processor's time and memory."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from diagnosis_rows.figures import Figure, at_most

#: Units of the tables, and times that each is diagnosed; chance is drawn once more before.
UNITS, TIMES = (100, 400), 3
#: Goals of the larger table: s of processor, GB. Memory that is flat in the units has the power 0.
MOST_S, MOST_GB, MOST_POWER = 12.0, 0.5, 0.1


class Cost(NamedTuple):
    """Of a command: the processor's time and the most memory that it held."""

    processor_s: float
    memory_GB: float


def many_units(seed: int) -> list[Figure]:
    """Time and memory of `station diagnose`, and the power of the units that the memory follows."""
    with tempfile.TemporaryDirectory() as folder:
        every = [_costs(units, seed, Path(folder)) for units in UNITS]
    few, many = (np.array(costs) for costs in every)
    power = np.log(many[:, 1] / few[:, 1]) / np.log(UNITS[1] / UNITS[0])
    return [
        _figure(
            f"{UNITS[1]} units, processor", many[:, 0], MOST_S, f"s; {UNITS[0]} units {np.median(few[:, 0]):.1f} s"
        ),
        _figure(
            f"{UNITS[1]} units, memory", many[:, 1], MOST_GB, f"GB; {UNITS[0]} units {np.median(few[:, 1]):.2f} GB"
        ),
        _figure("memory against units, p", power, MOST_POWER, "GB ∝ unitsᵖ"),
    ]


def _figure(what: str, values: "np.typing.NDArray[np.float64]", most: float, note: str) -> Figure:
    value = float(np.median(values))
    goal, met = at_most(value, most)
    return Figure(what, value, float(values.min()), float(values.max()), len(values), goal, met, note)


def _costs(units: int, seed: int, folder: Path) -> list[Cost]:
    samples, station = folder / f"{units}.parquet", [sys.executable, "-m", "station"]
    campaign = ["--recipe", "tilt-24", "--units", str(units), "--effect", "hysteresis", "--seed", str(seed)]
    _cost([*station, "simulate", *campaign, "--out", str(samples)], folder)
    diagnose = [*station, "diagnose", "--samples", str(samples), "--recipe", "tilt-24"]
    _cost(diagnose, folder)
    return [_cost(diagnose, folder) for _ in range(TIMES)]


def _cost(command: list[str], cache: Path) -> Cost:
    """Of a command; exit code 1 is a finding."""
    begun = subprocess.Popen(command, stdout=subprocess.DEVNULL, env={**os.environ, "XDG_CACHE_HOME": str(cache)})
    _, status, used = os.wait4(begun.pid, 0)
    if (code := os.waitstatus_to_exitcode(status)) not in (0, 1):
        raise SystemExit(f"{' '.join(command)} ended with {code}")
    begun.returncode = code
    return Cost(used.ru_utime + used.ru_stime, used.ru_maxrss * 1024 / 1e9)
