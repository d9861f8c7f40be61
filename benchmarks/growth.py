"""How time and memory grow with samples, units, nests, positions, effects and the log: exponents, and a picture.

    python benchmarks/growth.py [--quick] [--runs 3] [--only calibrate replay] [--picture docs/pictures/growth.svg]

Row 13. Every point is a command of the station in a process of its own, which has done the same on the smallest input
first, so that imports are paid. Time is the processor's; memory is how far the process's peak rose above what it held
before. All sizes are measured one after the other, round after round, so that a busy minute of the machine falls on
all of them. The exponent is the slope of time against size, both logarithmic, between the last two sizes, where the
overhead that hides growth is least: the median of the rounds, with the least and the greatest; that over all sizes
stands beside it. Goal: at most 1.05, and memory that does not grow over the same last step on the paths that stream:
they work portion by portion, and their last two sizes are several portions each. --quick leaves the largest size out,
and is one round.
"""

import argparse
import contextlib
import math
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cycle
import figures
import growth_inputs

GOAL = 1.05
#: Over the last step, mostly a decade, the memory of a streaming path may grow by so much, MiB: noise, no slope.
FLAT_MIB = 30.0


@dataclass(frozen=True, slots=True)
class Way:
    """One way through the station. over: what grows; prepare: makes the input; command: the words after `station`.

    streams: whether memory must not grow. keeps: whether a first run leaves something for later ones, as the diagnosis
    its null distribution; a later one is measured. own: only the station's time counts, without that of the simulated
    rig, whose actors all act at every instant at which one of them does.
    """

    name: str
    over: str
    sizes: tuple[int, ...]
    prepare: Callable[[Path, int], None]
    command: Callable[[Path, int], list[str]]
    streams: bool = False
    keeps: bool = False
    own: bool = False


def _tables(kind: str) -> Callable[[Path, int], list[str]]:
    return lambda folder, size: [
        *("calibrate", "--samples", str(folder / f"{kind}-{size}.parquet")),
        *("--recipe", str(folder / f"{kind}-{size}.yaml"), "--json", str(folder / "out.json")),
    ]


def _log(folder: Path, size: int) -> list[str]:
    return ["--db", str(folder / f"log-{size}.db")]


def _simulate(folder: Path, units: int, more: Sequence[str] = ()) -> list[str]:
    out = str(folder / "simulated.parquet")
    return ["simulate", "--recipe", "tilt-24", "--units", str(units), "--out", out, *more]


def _run(folder: Path, units: int, more: Sequence[str] = ()) -> list[str]:
    log = str(folder / f"run-{units}-{time.monotonic_ns()}.db")
    return ["run", "--simulate", "--units", str(units), "--db", log, "--json", *more]


PATHS = (
    Way(
        "calibrate",
        "samples",
        (4_000, 40_000, 400_000, 4_000_000),
        growth_inputs.samples,
        _tables("samples"),
    ),
    Way("calibrate", "units", (4, 80, 800, 4000), growth_inputs.units, _tables("units"), streams=True),
    Way("calibrate", "stops", (6, 60, 600, 6000), growth_inputs.stops, _tables("stops")),
    Way("simulate", "units", (1, 50, 200, 1000), growth_inputs.nothing, _simulate, streams=True),
    Way(
        *("simulate", "effects", (1, 3, 9, 36), growth_inputs.nothing),
        lambda folder, size: _simulate(folder, 10, growth_inputs.effects(size)),
    ),
    Way("run", "units", (1, 10, 100), growth_inputs.nothing, _run, streams=True, own=True),
    Way(
        *("run", "nests", (1, 2, 16), growth_inputs.config),
        lambda folder, size: _run(folder, size, ("--config", str(folder / f"nests-{size}.yaml"))),
        own=True,
    ),
    Way(
        *("replay", "units", (1, 10, 60), growth_inputs.frames),
        lambda folder, size: ["replay", str(folder / f"frames-{size}.log"), "--recipe", "six-point", "--json"],
    ),
    Way(
        *("audit --verify", "units", (10, 100, 1000), growth_inputs.log),
        lambda folder, size: ["audit", "--verify", *_log(folder, size)],
        streams=True,
    ),
    Way(
        *("export", "units", (10, 100, 1000), growth_inputs.log),
        lambda folder, size: ["export", "--samples", str(folder / "export.parquet"), *_log(folder, size)],
        streams=True,
    ),
    Way(
        *("backtest", "units", (10, 100, 1000), growth_inputs.log),
        lambda folder, size: ["backtest", "--recipe", "six-point", "--processes", "1", "--json", *_log(folder, size)],
        streams=True,
    ),
    Way(
        *("diagnose", "units", (4, 40, 400), growth_inputs.campaign),
        lambda folder, size: [
            *("diagnose", "--recipe", "tilt-24", "--samples", str(folder / f"campaign-{size}.parquet")),
            *("--json", str(folder / "diagnosis.json")),
        ],
        keeps=True,
    ),
)


@dataclass(frozen=True, slots=True)
class Grown:
    """What one path came to, round by round: processor time, s, and rise of memory, MiB, at each size."""

    path: Way
    sizes: tuple[int, ...]
    rounds: tuple[tuple[tuple[float, float], ...], ...]

    @property
    def seconds(self) -> tuple[float, ...]:
        """Median time at each size."""
        return tuple(statistics.median(s for s, _ in of_size) for of_size in zip(*self.rounds, strict=True))

    @property
    def mib(self) -> tuple[float, ...]:
        """Median memory at each size."""
        return tuple(statistics.median(m for _, m in of_size) for of_size in zip(*self.rounds, strict=True))

    @property
    def exponents(self) -> tuple[float, ...]:
        """Between the last two sizes, of each round."""
        return tuple(self._slope(self.sizes[-2:], [s for s, _ in done[-2:]]) for done in self.rounds)

    @property
    def exponent(self) -> float:
        """Their median."""
        return statistics.median(self.exponents)

    @property
    def overall(self) -> float:
        """Least squares over all sizes."""
        return self._slope(self.sizes, self.seconds)

    @property
    def added_mib(self) -> float:
        """By how much memory grew over the last step."""
        return self.mib[-1] - self.mib[-2]

    @property
    def good(self) -> bool:
        """Whether both goals are reached."""
        return self.exponent <= GOAL and (not self.path.streams or self.added_mib <= FLAT_MIB)

    @staticmethod
    def _slope(sizes: Sequence[int], seconds: Sequence[float]) -> float:
        x, y = [math.log(n) for n in sizes], [math.log(s) for s in seconds]
        mx, my = sum(x) / len(x), sum(y) / len(y)
        return sum((a - mx) * (b - my) for a, b in zip(x, y, strict=True)) / sum((a - mx) ** 2 for a in x)


def main() -> None:
    """Prints every path with its exponent, and draws the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--only", nargs="+", help="paths, by the beginning of their names")
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--child", nargs=3, metavar=("NUMBER", "SIZE", "FOLDER"), help=argparse.SUPPRESS)
    parser.add_argument("--prepare", nargs=3, metavar=("NUMBER", "SIZE", "FOLDER"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child or given.prepare:
        number, size, folder = given.child or given.prepare
        (_measure if given.child else _prepare)(PATHS[int(number)], int(size), Path(folder))
        return
    print(f"python {sys.version.split()[0]}, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for number, path in enumerate(PATHS):
            if not given.only or any(path.name.startswith(name) for name in given.only):
                sizes, rounds = (path.sizes[:-1], 1) if given.quick else (path.sizes, given.runs)
                found.append(_grown(number, path, sizes, rounds, Path(folder)))
                _tell(found[-1])
    good = all(g.good for g in found)
    worst = max(found, key=lambda g: g.exponent)
    fat = max((g for g in found if g.path.streams), key=lambda g: g.added_mib, default=worst)
    print(f"row 13: worst exponent {worst.exponent:.2f} ({worst.path.name} against {worst.path.over}), ", end="")
    print(f"most memory that a streaming path gained with size {fat.added_mib:.0f} MiB ({fat.path.name}); ", end="")
    print(f"goal <= {GOAL} and flat: {'reached' if good else 'NOT reached'}")
    where = f"{worst.path.name} against {worst.path.over}, {_spread(worst)}"
    figure = f"worst exponent {worst.exponent:.3f} ({where}); memory +{fat.added_mib:.0f} MiB ({fat.path.name})"
    figures.keep(13, f"growth of {len(found)} paths", figure, "a straight line", f"<= {GOAL}, flat", good)
    if given.picture:
        import growth_picture

        given.picture.write_text(growth_picture.drawn(found), encoding="utf-8")
        print(f"drawn: {given.picture}")


def _grown(number: int, path: Way, sizes: Sequence[int], rounds: int, folder: Path) -> Grown:
    for size in sizes:
        _child("--prepare", number, size, folder)
    return Grown(
        path, tuple(sizes), tuple(tuple(_point(number, size, folder) for size in sizes) for _ in range(rounds))
    )


def _point(number: int, size: int, folder: Path) -> tuple[float, float]:
    seconds, mib = _child("--child", number, size, folder).split()
    return float(seconds), float(mib)


def _child(what: str, number: int, size: int, folder: Path) -> str:
    command = [sys.executable, __file__, what, str(number), str(size), str(folder)]
    # A second thread of the linear algebra only waits, and its waiting would count; numpy is told before it loads.
    surroundings = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "XDG_CACHE_HOME": str(Path(folder) / "cache")}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=surroundings)
    if done.returncode:
        raise SystemExit(f"{PATHS[number].name} with {size} {PATHS[number].over} failed: {done.stderr[-2000:]}")
    return done.stdout


def _prepare(path: Way, size: int, folder: Path) -> None:
    path.prepare(folder, size)
    if path.keeps:
        _command(path.command(folder, size))


def _measure(path: Way, size: int, folder: Path) -> None:
    """Runs the command; says its processor time, s, and how far it raised the peak of memory, MiB."""
    ledger = cycle.Ledger()
    if path.own:
        cycle.wrap(ledger)
    _timed(path.command(folder, path.sizes[0]), ledger)
    before_mib = _peak_mib()
    # Once: a second time would find the memory of the first at hand, which large inputs are never given twice.
    print(_timed(path.command(folder, size), ledger), _peak_mib() - before_mib)


def _timed(words: list[str], ledger: cycle.Ledger) -> float:
    """Processor time of one command, s, without the simulated rig's where that is told apart."""
    ledger.begin()
    began_s = _cpu_s()
    _command(words)
    ledger.settle()
    return _cpu_s() - began_s - ledger.spent[cycle.RIG][1]


def _command(words: list[str]) -> None:
    from station.cli.app import main

    with Path(os.devnull).open("w") as nowhere, contextlib.redirect_stdout(nowhere):
        try:
            main(words)
        except SystemExit as done:
            if done.code not in (0, 1):
                raise


def _cpu_s() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def _peak_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _tell(g: Grown) -> None:
    points = ", ".join(f"{n}: {s:.3g} s" for n, s in zip(g.sizes, g.seconds, strict=True))
    memory = f"memory {', '.join(f'+{m:.0f}' for m in g.mib)} MiB{' (streams)' if g.path.streams else ''}"
    verdict = "reached" if g.good else "NOT reached"
    slopes = f"exponent {g.exponent:.3f} at the end ({_spread(g)}), {g.overall:.2f} over all"
    print(f"{g.path.name} against {g.path.over}: {slopes}; {memory}: {verdict}")
    print(f"  {points}", flush=True)


def _spread(g: Grown) -> str:
    return f"{min(g.exponents):.3f} to {max(g.exponents):.3f} in {len(g.exponents)} runs"


if __name__ == "__main__":
    main()
