"""`python benchmarks/rig.py [--mountings 100] [--kills 12] [--stops 60]`: drives with faults, kills, stops, mountings.

On simulated time, by the adapter and frames of a bench; the stop is measured on a wire, by the clock of this machine.
"""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy import stats

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import stop_wire

from station.domain.rig.paths import safe_way
from tests.fakes.driven_rig import DrivenRig, frames_of_a_life, killed_life, visit
from tests.fakes.mountings import drawn, wrong
from tests.integration.test_drive_faults import DRIVES_ASTRAY, HOMES, HOMING, OUTCOMES
from tests.unit.test_rig_axis_errors import ANGLES, campaign, estimated

SEED = 20261122
FACES = ("+x", "-y", "-x", "+y", "-z", "+z")


def faults() -> tuple[str, str]:
    """Every fault on either axis: uncommanded moves, false arrivals, wrong outcomes."""
    unasked = false = wrong_outcome = total = 0
    for kind, wanted in OUTCOMES.items():
        plain = kind.partition(":")[0]
        for axis in (0, 1):
            text = kind + ("," if ":" in kind else ":") + f"axis={axis}"
            rig = DrivenRig(HOMING if plain.startswith(HOMES) else "two-axis", [text])
            fault = None
            for up in ("-y", "+x") if axis == 0 else ("+x", "-y"):
                fault = rig.move(up)
                if fault is not None:
                    break
                off = min(float(np.abs(rig.truth_deg() - g).max()) for g in np.array(rig.map.goals(visit(up).nest)))
                false += off > rig.map.axes[0].window_deg
                rig.clock.sleep(0.5)
            rig.park()
            rig.clock.sleep(0.5)
            total += 1
            astray = plain in DRIVES_ASTRAY
            unasked += rig.witness.excess_deg > DRIVES_ASTRAY.get(plain, 0.5) or not rig.stands()
            unasked += rig.witness.unasked_s > (0.05 if astray else 0.0)
            wrong_outcome += (fault.message.id if fault else None) != wanted and not _of_node(plain, axis, fault)
    return f"{unasked} uncommanded, {false} false arrivals, {wrong_outcome} wrong outcomes of {total}", "0, 0, 0"


def _of_node(plain: str, axis: int, fault: object) -> bool:
    """A fault of the node's own objects shows on its first axis alone."""
    return axis == 1 and plain in ("other-type", "watch-refused", "watch-missing") and fault is None


def kills(every: int) -> tuple[str, str]:
    """SIGKILL in front of every n-th frame of a life, on both rigs."""
    bad = total = 0
    for name in ("two-axis", "two-axis-homing"):
        for frame in range(0, len(frames_of_a_life(name)) + 1, every):
            total += 1
            bad += bool(killed_life(name, frame))
    return f"{bad} unsafe of {total} (every {every}th frame)", "0"


def stops(count: int) -> tuple[str, str]:
    """From the operator's signal to the frame of the quick stop on the wire, between four processes."""
    taken, together = stop_wire.measured(count, SEED)
    low, median, p99, high = (float(np.percentile(taken, q)) * 1e3 for q in (0, 50, 99, 100))
    figure = f"median {median:.2f} ms, p99 {p99:.2f} ms [{low:.2f}, {high:.2f}]; both axes at one SYNC {together}"
    return f"{figure} of {count}", "20 ms; all"


def overhead() -> tuple[str, str]:
    """24 moves between faces against the drives' own time: trapezium and window of each."""
    rig = DrivenRig()
    rig.move("+z")
    began_s, own_s = rig.clock.monotonic_s(), 0.0
    at = rig.map.park_deg
    for number in range(24):
        nest = visit(FACES[number % 6]).nest
        way = safe_way(rig.map.space, at, rig.map.goals(nest))
        assert way is not None
        own_s += way[0] + len(way[1]) * rig.map.axes[0].window_s
        at = way[1][-1]
        assert rig.move(FACES[number % 6]) is None
    took_s = rig.clock.monotonic_s() - began_s
    return f"{100 * (took_s / own_s - 1):.2f} % over {own_s:.1f} s", "2 %"


def mountings(count: int) -> tuple[str, str]:
    """Random mountings that `rig check` sees through."""
    rng = np.random.default_rng(SEED)
    right = 0
    for number in range(count):
        mounting = drawn(rng)
        found = wrong(mounting, SEED + number)
        right += not found
        if found:
            print(f"  mounting {number}: {mounting}: {found}")
    return f"{right} of {count}", "all"


def axis_errors() -> tuple[str, str]:
    """Errors of the axes from eight units in 24 positions."""
    rng = np.random.default_rng(SEED)
    worst, covered, tried = 0.0, 0, 0
    for _ in range(60):
        true, readings = campaign(rng, ANGLES)
        for error, value in zip(estimated(ANGLES, readings).errors, true.tolist(), strict=True):
            if error.value is not None and error.interval is not None:
                worst = max(worst, abs(error.value - value))
                covered += abs(error.value - value) <= error.interval
                tried += 1
    low, high = stats.beta.ppf([0.025, 0.975], [covered, covered + 1], [tried - covered + 1, tried - covered])
    return f"worst {worst:.4f}°, coverage {covered / tried:.3f} [{low:.3f}, {high:.3f}] of {tried}", ".01°, .95"


def main() -> None:
    """See the top of the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mountings", type=int, default=100)
    parser.add_argument("--kills", type=int, default=12, help="every how many frames")
    parser.add_argument("--stops", type=int, default=60)
    asked = parser.parse_args()
    rows: tuple[tuple[str, Callable[[], tuple[str, str]]], ...] = (
        ("injected faults", faults),
        ("SIGKILL", lambda: kills(asked.kills)),
        ("stop to quick stop", lambda: stops(asked.stops)),
        ("overhead of 24 moves", overhead),
        ("axis errors, 8 units", axis_errors),
        ("mountings", lambda: mountings(asked.mountings)),
    )
    print(f"seed {SEED}")
    for name, measure in rows:
        began_s = time.monotonic()
        figure, goal = measure()
        print(f"{name:22} {figure}   (goal {goal}; {time.monotonic() - began_s:.0f} s)", flush=True)


if __name__ == "__main__":
    main()
