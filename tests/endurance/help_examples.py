"""`python tests/endurance/help_examples.py [--orders N] [--seed S] [--part K/N]`: every example of every help, in
N random orders, then every block of every guide, each guide in a fresh copy of the folder that `station demo` leaves.

`--part 2/4` tries the second quarter of the examples and of the guides; the four parts together are the whole.
"""

import argparse
import random
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.fakes.help_examples import (
    GUIDES,
    SCREEN,
    Tried,
    all_help_examples,
    badly_laid_out,
    guide_examples,
    needs_person,
    needs_plant,
    try_example,
)

#: `rig axes` reads what this example measures: every part begins with it.
MEASURES_WITH_DRIVES = "station run --config drives.yaml"


def main() -> int:
    """See the top of the file; 1 when an example does not run."""
    # In the background of a shell Ctrl-C is ignored, and so it would be in every server that is tried.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--orders", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--part", type=parse_part, default=(1, 1), metavar="K/N")
    wanted = parser.parse_args()
    failed: list[Tried] = []
    with tempfile.TemporaryDirectory() as name:
        tour = Path(name) / "tour"
        subprocess.run([sys.executable, "-m", "station", "demo", str(tour)], stdout=subprocess.DEVNULL, check=True)
        number, parts = wanted.part
        lines = all_help_examples()
        mine = set(lines[number - 1 :: parts])
        examples = [line for line in lines if line in mine or line.startswith(MEASURES_WITH_DRIVES)]
        pages = [page for page in GUIDES if guide_examples(page)][number - 1 :: parts]
        for seed in range(wanted.seed, wanted.seed + wanted.orders):
            random.Random(seed).shuffle(examples)
            examples.sort(key=lambda line: not line.startswith(MEASURES_WITH_DRIVES))
            failed += _try_all(examples, tour, Path(name) / f"order-{seed}")
        for page in pages:
            print(f"-- {page.name}")
            failed += _try_all(guide_examples(page), tour, Path(name) / f"guide-{page.stem}")
    print(f"{len(examples)} examples in {wanted.orders} orders from seed {wanted.seed}, {len(pages)} pages:", end=" ")
    print(f"{len(failed)} do not run")
    return 1 if failed else 0


def parse_part(text: str) -> tuple[int, int]:
    """`2/4` → (2, 4). Errors: ArgumentTypeError."""
    number, _, parts = text.partition("/")
    if not (number.isdecimal() and parts.isdecimal() and 1 <= int(number) <= int(parts)):
        raise argparse.ArgumentTypeError(f"{text}: write K/N with 1 <= K <= N, such as 2/4")
    return int(number), int(parts)


def _try_all(lines: list[str], tour: Path, folder: Path) -> list[Tried]:
    shutil.copytree(tour, folder)
    failed = []
    for line in lines:
        if needs_plant(line) or needs_person(line):
            continue  # tests/plant/test_help_examples.py, tests/integration/test_signatures.py
        tried = try_example(line, folder)
        print(f"{'ok ' if tried.right else 'NOT'} {tried.code:3d}  {line}", flush=True)
        if not tried.right:
            print(tried.errors[-600:], *badly_laid_out(line, tried.output, SCREEN), sep="\n")
            failed.append(tried)
    shutil.rmtree(folder)
    return failed


if __name__ == "__main__":
    raise SystemExit(main())
