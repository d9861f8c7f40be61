"""All benchmarks of speed in one go, and one table: what, figure, peer or limit, goal, reached or missed.

    python benchmarks/table.py [--quick] [--rows 1 6 7] [--write docs/benchmarks.md] [--folder DIR]

Each line comes from a script of its own, which has options of its own; here they run one after the other, some fifteen
minutes in all, a few with --quick. What cannot run on this machine says so in the table. --write puts the table into a
Markdown file, between its lines `<!-- bench -->` and `<!-- /bench -->`.
"""

import argparse
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import figures

HERE = Path(__file__).resolve().parent
BEGIN, END = "<!-- bench -->", "<!-- /bench -->"
VCAN = "on_vcan.py"


@dataclass(frozen=True, slots=True)
class Bench:
    """A script with the rows it fills; words, quick: its options; limit_s: when it is given up."""

    rows: tuple[int, ...]
    script: str
    words: tuple[str, ...] = ()
    quick: tuple[str, ...] = ()
    limit_s: float = 300.0
    folder: bool = False


BENCHES = (
    Bench((12,), "startup.py", ("--times", "9"), ("--times", "5")),
    Bench((1,), "receive.py", ("--rows", "1", "--runs", "11"), ("--rows", "1", "--runs", "5")),
    Bench((2,), "receive.py", ("--rows", "2", "--seconds", "5"), ("--rows", "2", "--seconds", "2")),
    Bench((1, 2), VCAN, ("receive.py", "--rows", "1", "--runs", "5"), ("receive.py", "--rows", "1", "--runs", "5")),
    Bench((3,), "dwell.py", (), ("--units", "200"), limit_s=900.0),
    Bench((4,), "order.py", (), ("--sets", "8")),
    Bench((5,), "writeback.py", ("--runs", "15"), ("--runs", "7")),
    Bench((5,), VCAN, ("writeback.py", "--runs", "7"), ("writeback.py", "--runs", "5")),
    Bench((6,), "cycle.py", ("--runs", "5"), ("--runs", "2")),
    Bench((7,), "store.py", ("--rows", "7", "--stops", "300"), ("--rows", "7", "--stops", "100"), folder=True),
    Bench((8,), "store.py", ("--rows", "8", "--units", "4"), ("--rows", "8", "--units", "1")),
    Bench(
        *((9,), "audit.py", ("--units", "1000000", "--no-walk"), ("--units", "20000", "--every", "2", "--no-walk")),
        limit_s=600.0,
        folder=True,
    ),
    Bench((10,), "solving.py", ("--runs", "5"), ("--units", "1024", "--runs", "3")),
    Bench((11,), "backtest.py", ("--units", "100000"), ("--units", "2000"), limit_s=600.0, folder=True),
    Bench((13,), "growth.py", ("--picture", str(HERE.parent / "docs/pictures/growth.svg")), ("--quick",), 1800.0),
)


def main() -> None:
    """Runs what is wanted and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--rows", type=int, nargs="+", help="only these rows")
    parser.add_argument("--write", type=Path, help="a Markdown file that has the two marks")
    parser.add_argument("--folder", type=Path, default=Path.cwd(), help="on the disk that is to be measured; some GB")
    given = parser.parse_args()
    began_s, load_before, lines = time.monotonic(), os.getloadavg()[0], []
    wanted = [b for b in BENCHES if not given.rows or set(b.rows) & set(given.rows)]
    for bench in wanted:
        lines += ran(bench, given.folder, quick=given.quick)
    head = f"Python {platform.python_version()}, {os.cpu_count()} processors, Linux {platform.release()}"
    requested = "make bench" if not given.quick else "make bench QUICK=1"
    load = f"load {load_before:.1f} at the beginning and {os.getloadavg()[0]:.1f} at the end"
    lines.sort(key=lambda line: int(line[0].split(",")[0]))
    shown = f"`{requested}` in {(time.monotonic() - began_s) / 60:.0f} min: {head}, {load}."
    text = "\n".join([shown, "", *table(lines)])
    print(text)
    if given.write:
        put(given.write, text)


def ran(bench: Bench, folder: Path, *, quick: bool) -> list[list[str]]:
    """Lines of the table that one script fills, or one that says why there is none."""
    words = bench.quick if quick and bench.quick else bench.words
    name = words[0] + " in a vcan" if bench.script == VCAN else bench.script
    if not (HERE / bench.script).exists():
        return [_missing(bench, name, "no such benchmark yet")]
    print(f"{time.strftime('%H:%M:%S')} {name} {' '.join(words)}", file=sys.stderr, flush=True)
    if bench.folder:
        words = (*words, "--folder", str(folder))
    with tempfile.TemporaryDirectory() as place:
        stored = Path(place) / "figures"
        surroundings = {
            **os.environ,
            figures.STORED_IN: str(stored),
            "PYTHONPATH": str(HERE.parent),
            "OPENBLAS_NUM_THREADS": "1",
        }
        command = [sys.executable, str(HERE / bench.script), *words]
        try:
            done = subprocess.run(
                command, env=surroundings, capture_output=True, text=True, check=False, timeout=bench.limit_s
            )
        except subprocess.TimeoutExpired:
            return [*_lines(stored, name), _missing(bench, name, f"not done after {bench.limit_s:.0f} s")]
        print(done.stdout, file=sys.stderr, flush=True)
        found = _lines(stored, name)
        if not found:
            why = (done.stderr.strip() or done.stdout.strip() or "nothing said").splitlines()[-1]
            return [_missing(bench, name, f"does not run here: {why[:160]}")]
        return found


def _lines(stored: Path, name: str) -> list[list[str]]:
    verdict = {True: "reached", False: "**missed**"}
    return [
        [str(f.row), f.what, f.figure, f.peer, f.goal, verdict[f.reached], f"`{name.split(maxsplit=1)[0]}`"]
        for f in figures.stored(stored)
    ]


def _missing(bench: Bench, name: str, why: str) -> list[str]:
    return [", ".join(map(str, bench.rows)), name, why, "", "", "not measured", f"`{name.split(maxsplit=1)[0]}`"]


def table(lines: Sequence[Sequence[str]]) -> list[str]:
    """Markdown."""
    names = ("row", "what", "figure: median (spread, runs)", "peer or limit", "goal", "", "script in `benchmarks/`")
    rows = [names, ["---"] * len(names), *lines]
    return ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]


def put(path: Path, text: str) -> None:
    """Replaces what stands between the marks."""
    printed = path.read_text(encoding="utf-8")
    if BEGIN not in printed or END not in printed:
        raise SystemExit(f"{path} has no lines {BEGIN} and {END} to put the table between")
    before, rest = printed.split(BEGIN, 1)
    path.write_text(f"{before}{BEGIN}\n{text}\n{END}{rest.split(END, 1)[1]}", encoding="utf-8")


if __name__ == "__main__":
    main()
