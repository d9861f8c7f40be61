"""`python benchmarks/lss.py [--scans 10]`: how long LSS takes in simulated time, the wire's 0.27 ms a frame added."""

import argparse
import random
import statistics
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from station.ports.lss import LssIdentity
from tests.fakes.lss_fleet import PRODUCT, WIRE_S, Fleet, Member, seats_of

NODES = tuple(range(0x11, 0x21))


def scans(count: int) -> list[float]:
    """Seconds of a fast scan among 16 devices with random identities of 128 bits."""
    found = []
    for seed in range(count):
        rng = random.Random(seed)
        fleet = Fleet([Member(LssIdentity(*(rng.getrandbits(32) for _ in range(4)))) for _ in NODES])
        master, start_s = fleet.bench(NODES).lss, fleet.clock.monotonic_s()
        master.scan()
        found.append(fleet.clock.monotonic_s() - start_s + 2 * WIRE_S * fleet.channel.sent)
        fleet.close()
    return found


def selections() -> list[float]:
    """Seconds to select each of 16 devices, prove it alone, and give it its id, stored."""
    identities = [LssIdentity(PRODUCT.vendor, PRODUCT.product, PRODUCT.revision, i + 1) for i in range(16)]
    fleet = Fleet([Member(i) for i in identities])
    master, found = fleet.bench(NODES).lss, []
    for node, identity in zip(NODES, identities, strict=True):
        start_s, sent = fleet.clock.monotonic_s(), fleet.channel.sent
        master.select(identity)
        master.configure_node(node)
        master.store()
        master.release()
        found.append(fleet.clock.monotonic_s() - start_s + 2 * WIRE_S * (fleet.channel.sent - sent))
    fleet.close()
    return found


def whole(*, labelled: bool) -> float:
    """Seconds to address 16 fresh devices and read their identities at their ids; those of the boots included."""
    identities = [LssIdentity(PRODUCT.vendor, PRODUCT.product, PRODUCT.revision, i + 1) for i in range(16)]
    fleet = Fleet([Member(i) for i in identities])
    start_s = fleet.clock.monotonic_s()
    fleet.commission(seats_of(NODES, identities if labelled else [None] * 16))
    took_s = fleet.clock.monotonic_s() - start_s + 2 * WIRE_S * fleet.frames
    fleet.close()
    return took_s


def main() -> int:
    """Prints every figure with its goal."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scans", type=int, default=10)
    wanted = parser.parse_args()
    scanned, selected = scans(wanted.scans), selections()
    mean, worst = statistics.mean(scanned), max(scanned)
    print(f"fast scan of a random identity, {len(scanned)}: {mean:.2f} s, at worst {worst:.2f} s (goal 4 s)")
    print(f"selected and addressed, 16: at worst {1000 * max(selected):.1f} ms each (goal 50 ms)")
    print(f"16 devices, whole command: {whole(labelled=True):.1f} s by label, {whole(labelled=False):.1f} s by scan")
    return 1 if worst > 4 or max(selected) > 0.05 else 0


if __name__ == "__main__":
    raise SystemExit(main())
