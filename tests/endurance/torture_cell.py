"""`python -m tests.endurance.torture_cell [--step N]`: SIGKILL at every request of a load in a cell without a PLC.

After each kill the next station finishes the load: no unit leaves as its verdict forbids, none is tested twice.
"""

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.fakes.remote_cell import killed_load, requests_of_a_load


def main() -> int:
    """See the top of the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--step", type=int, default=1, help="every how many requests")
    step = parser.parse_args().step
    with TemporaryDirectory() as folder:
        killed = range(1, requests_of_a_load(Path(folder) / "whole") + 1, step)
        wrong = [text for at in killed if (text := killed_load(Path(folder) / str(at), at))]
    print("\n".join(wrong), end="\n" if wrong else "")
    print(f"{len(killed)} kills, {len(wrong)} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
