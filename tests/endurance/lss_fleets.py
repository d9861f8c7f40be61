"""`python tests/endurance/lss_fleets.py [--fleets N] [--most M] [--killed K] [--seed S]`: N random fleets addressed,
then the masters of the first K killed at each frame in turn; prints every mistake."""

import argparse
import random

from tests.fakes.lss_fleet import Fleet, killed_and_repeated, mistakes, random_fleet


def main() -> int:
    """See the top of the file; 1 when a fleet came out wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fleets", type=int, default=10_000)
    parser.add_argument("--most", type=int, default=16)
    parser.add_argument("--killed", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    wanted = parser.parse_args()
    wrong = devices = kills = 0
    for seed in range(wanted.seed, wanted.seed + wanted.fleets):
        members, seats = random_fleet(random.Random(seed), wanted.most)
        fleet = Fleet(members)
        found = mistakes(fleet, seats, fleet.commission(seats))
        fleet.close()
        devices += len(members)
        wrong += bool(found)
        if found:
            print(f"seed {seed}: {found}", flush=True)
        if seed < wanted.seed + wanted.killed:
            for frame in range(fleet.frames):
                kills += 1
                if found := killed_and_repeated(members, seats, frame):
                    wrong += 1
                    print(f"seed {seed}, killed at frame {frame}: {found}", flush=True)
    print(f"{wanted.fleets} fleets from seed {wanted.seed}, {devices} devices, {kills} kills: {wrong} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
