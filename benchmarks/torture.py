"""Everything that is promised about the worst days, tried in earnest: `make torture`.

    python benchmarks/torture.py [--seed 1] [--instants 1000] [--edits 10000] [--inputs 100000] [--units 10000]

Minutes to hours, by the numbers asked for; each part prints its count and its goal, and can be run alone.
"""

import argparse
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent


def main() -> int:
    """Runs every part; 1 when one of them broke off."""
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, most in (("seed", 1), ("instants", 1000), ("edits", 10_000), ("inputs", 100_000), ("units", 10_000)):
        ask.add_argument(f"--{name}", type=int, default=most)
    asked = ask.parse_args()
    parts = (
        ("torture_kill.py", "--instants", asked.instants, "--seed", asked.seed),
        ("torture_edits.py", asked.edits, asked.seed),
        ("torture_input.py", asked.inputs, asked.seed),
        ("torture_lasting.py", "--units", asked.units, "--after", min(500, asked.units // 2)),
    )
    codes = [subprocess.call([sys.executable, str(HERE / file), *map(str, options)]) for file, *options in parts]
    return int(any(codes))


if __name__ == "__main__":
    sys.exit(main())
