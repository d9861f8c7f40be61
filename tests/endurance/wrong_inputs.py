"""`python tests/endurance/wrong_inputs.py [--each N] [--seed S]`: N wrong inputs of every kind of file and command."""

import argparse
import collections
import contextlib
import io
import os
import random
import sys
import tempfile
from pathlib import Path

from tests.fakes.wrong_inputs import FILES, Complaint, all_commands, complaint, wrong_files, wrong_lines


def main() -> int:
    """See the top of the file; 1 where one is refused badly."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--each", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    wanted = parser.parse_args()
    found: dict[str, list[Complaint]] = collections.defaultdict(list)
    tried = 0
    sys.stdin = io.StringIO()
    with tempfile.TemporaryDirectory() as name, contextlib.redirect_stdout(io.StringIO()):
        os.chdir(name)
        for kind in FILES:
            for wrong in wrong_files(kind, Path(name), random.Random(f"{wanted.seed}{kind}"), wanted.each):
                tried += 1
                if (bad := complaint(wrong)) is not None:
                    found[kind].append(bad)
        for command in all_commands():
            for wrong in wrong_lines(command, random.Random(f"{wanted.seed}{command}"), wanted.each):
                tried += 1
                if (bad := complaint(wrong)) is not None:
                    found[f"station {command}"].append(bad)
        os.chdir("/")
    for kind, bads in found.items():
        print(f"{kind}: {len(bads)} of {wanted.each}")
        for bad in bads[:5]:
            print(f"    {bad.wrong.what}: {bad.why}: {bad.sentence[:300]}")
    print(f"{tried} wrong inputs, seed {wanted.seed}: {sum(map(len, found.values()))} refused badly")
    return 1 if found else 0


if __name__ == "__main__":
    raise SystemExit(main())
