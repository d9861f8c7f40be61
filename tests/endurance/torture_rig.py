"""`python -m tests.endurance.torture_rig [--step N] [--first N]`: SIGKILL in front of every frame of two rigs' lives.

A life prepares the drives (and homes them), moves, is stopped by the operator in mid-move, and parks. After each kill
the rig must stand within half a second, and the next station must come where it is sent without a motion unasked.
"""

import argparse
import sys
import time

from tests.fakes.driven_rig import frames_of_a_life, killed_life


def main() -> int:
    """See the top of the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--step", type=int, default=1, help="every how many frames")
    parser.add_argument("--first", type=int, default=0, help="first frame: slices --first 0 … N-1 are all of --step N")
    given = parser.parse_args()
    wrong = 0
    for map_name in ("two-axis", "two-axis-homing"):
        began_s = time.monotonic()
        frames = range(given.first, len(frames_of_a_life(map_name)) + 1, given.step)
        found = [text for frame in frames if (text := killed_life(map_name, frame))]
        wrong += len(found)
        print("\n".join(found), end="\n" if found else "")
        print(f"{map_name}: {len(frames)} kills, {len(found)} unsafe, {time.monotonic() - began_s:.0f} s")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
