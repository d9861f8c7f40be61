"""`python tests/endurance/wrong_inputs.py [--each N] [--seed S] [--part K/N]`: N wrong inputs of every kind of file, N
wrong lines of every command, and N of its examples made wrong in the folder that `station demo` leaves.

`--part 2/8` tries the second eighth of kinds and commands; `--show` prints every input with the answer.
"""

import argparse
import random
import shutil
import tempfile
import zlib
from collections.abc import Iterator
from pathlib import Path

from station.errors import UsageError
from tests.endurance.help_examples import parse_part
from tests.fakes.command import Done, captured
from tests.fakes.forked import forked
from tests.fakes.wrong_examples import all_names, write_wrong_files, wrong_examples
from tests.fakes.wrong_inputs import (
    ENDED,
    FILES,
    Complaint,
    WrongInput,
    all_commands,
    complaint,
    wrong_files,
    wrong_lines,
)

#: What is right after all may go on so long.
LIMIT_S = 8.0
#: Endings of files that say who has a log open.
_OPENED = (".db-shm", ".db-wal", ".lock")


def main() -> int:
    """See the top of the file; 1 where one is refused badly."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--each", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--part", type=parse_part, default=(1, 1), metavar="K/N")
    parser.add_argument("--show", action="store_true")
    wanted = parser.parse_args()
    number, parts = wanted.part
    kinds = [*(f"file: {kind}" for kind in FILES), *(f"line: {name}" for name in all_commands())]
    kinds += [f"example: {name}" for name in all_names()]
    tried = bad = 0
    with tempfile.TemporaryDirectory() as name:
        tour = Path(name) / "tour"
        captured("demo", tour)
        write_wrong_files(tour)
        for kind in kinds[number - 1 :: parts]:
            ours = _try_kind(kind, tour, random.Random(f"{wanted.seed}{kind}"), wanted.each, show=wanted.show)
            tried, bad = tried + ours[0], bad + ours[1]
            print(f"{kind}: {ours[1]} of {ours[0]}", flush=True)
    print(f"{tried} wrong inputs, seed {wanted.seed}, part {number}/{parts}: {bad} refused badly")
    return 1 if bad else 0


def _try_kind(kind: str, tour: Path, rng: random.Random, each: int, *, show: bool) -> tuple[int, int]:
    """So many were tried, so many refused badly."""
    folder = tour.with_name("here")
    shutil.copytree(tour, folder, symlinks=True)
    last = Done(0, "", "")

    def run(*words: str) -> Done:
        nonlocal last
        last = forked(folder, LIMIT_S)(*words)
        return last

    tried = bad = 0
    for wrong in _inputs(kind, folder, rng, each):
        tried += 1
        before = _kept(folder)
        found = complaint(wrong, run)
        if found is None and last.returncode == UsageError.exit_code and (changed := before ^ _kept(folder)):
            found = Complaint(wrong, f"changed {sorted({name for name, *_ in changed})}", last.stderr)
        if found is not None:
            bad += 1
            print(f"    {wrong.what}: {found.why}: {found.sentence[:300]}")
        elif show:
            print(f"    {wrong.what}: {last.returncode} {last.stderr.strip()[:300]}")
        if last.returncode == ENDED:
            shutil.rmtree(folder)
            shutil.copytree(tour, folder, symlinks=True)
    shutil.rmtree(folder)
    return tried, bad


def _kept(folder: Path) -> set[tuple[str, int]]:
    """Name and content of every file but those that say who has a log open."""
    files = (p for p in folder.rglob("*") if p.suffix not in _OPENED and (p.is_symlink() or p.is_file()))
    return {(str(p.relative_to(folder)), 0 if p.is_symlink() else zlib.crc32(p.read_bytes())) for p in files}


def _inputs(kind: str, folder: Path, rng: random.Random, each: int) -> Iterator[WrongInput]:
    what, _, name = kind.partition(": ")
    if what == "file":
        return wrong_files(name, folder, rng, each)
    return (wrong_lines if what == "line" else wrong_examples)(name, rng, each)


if __name__ == "__main__":
    raise SystemExit(main())
