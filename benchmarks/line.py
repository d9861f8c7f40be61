"""The line: faults of its PLC, crashes of station and PLC, PackML's transitions, and what the handshake costs.

python benchmarks/line.py [faults] [crashes] [packml] [overhead] [--crashes N] [--seed S]
"""

import argparse
import random
import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from figures import keep, spread

from station.adapters.clock import VirtualClock
from station.adapters.positioner.plc import PlcPositioner
from station.domain.cell.packml import DONE, Command, State, after_command, allowed
from station.domain.cell.state_times import StateTimes
from station.domain.recipe.moves import angles_deg, turn_s
from station.domain.recipe.position import UP
from station.errors import UsageError
from tests.fakes import crashing_cell, plc_faults

#: Rows of these figures in the table.
FAULTS, CRASHES, PACKML, OVERHEAD = 170, 171, 172, 173


def faults(_: argparse.Namespace) -> None:
    """Every fault once: right sentence, motion that nobody commanded, arrival outside of the window."""
    tried = {fault: plc_faults.attempt(fault) for fault in plc_faults.EXPECTED}
    wrong = [fault for fault, found in tried.items() if found.id != plc_faults.EXPECTED[fault]]
    uncommanded = sum(found.uncommanded_s > 0 for found in tried.values())
    outside = sum(found.off_deg > 0.5 for found in tried.values())
    text = f"{len(tried)} faults: {uncommanded} uncommanded, {outside} arrived outside, {len(tried) - len(wrong)} right"
    reached = not wrong and not uncommanded and not outside and len(tried) >= 20
    _say(FAULTS, "PLC faults: uncommanded moves; arrived outside; right sentence", text, "≥ 20; 0; 0; all", reached)


def crashes(given: argparse.Namespace) -> None:
    """Station and PLC die at random calls; the hand-over and the PLC's program are the real ones."""
    began = time.process_time()
    found = crashing_cell.endure(given.crashes, given.seed)
    took = time.process_time() - began
    text = (
        f"{found.crashes} of the station, {found.restarts} of the PLC, {found.units} units: twice {found.twice}, "
        f"skipped {found.skipped}, lost {found.lost}, wrong {found.wrong}, held {found.held} "
        f"(seed {given.seed}, {took:.0f} s)"
    )
    _say(CRASHES, f"{given.crashes} crashes: twice, skipped, lost, wrong verdict", text, "0", found.faults == 0)


def packml(given: argparse.Namespace) -> None:
    """A random walk of 100,000 commands, each against the list of what the state takes."""
    rng, steps = random.Random(given.seed), 100_000
    weights = [8.0, *(0.2 if c in (Command.STOP, Command.ABORT) else 2.0 for c in Command)]
    times, illegal, refused = StateTimes.begin(State.ABORTED, 0.0), 0, 0
    for step in range(steps):
        before, choice = times.state, rng.choices([None, *Command], weights)[0]
        try:
            times = times.done(float(step)) if choice is None else times.command(choice, float(step))
        except UsageError:
            refused += 1
            illegal += choice is None or choice in allowed(before)
            continue
        wanted = DONE.get(before, before) if choice is None else after_command(before, choice)
        illegal += times.state is not wanted or (choice is not None and choice not in allowed(before))
    cells = sum(len(allowed(state)) for state in State)
    text = f"{illegal} illegal, {refused} refused, {len(times.entries)} states visited, {cells} cells of the table"
    reached = illegal == 0 and len(times.entries) == len(State)
    _say(PACKML, "100,000 random PackML commands: illegal transitions", text, "0", reached)


def overhead(_given: argparse.Namespace) -> None:
    """A cycle of 24 positions on virtual time: moves by the handshake over the drive's own time."""
    shares = []
    for seed in range(5):
        rng, clock = random.Random(seed), VirtualClock()
        positioner = PlcPositioner(PlcPositioner.Settings(), clock)
        own_s, last = 0.0, np.eye(3)
        for _ in range(24):
            stop = plc_faults.stop(rng.choice(sorted(UP)))
            own_s += float(turn_s(angles_deg(last[None], stop.nest[None])[0, 0]))
            last = stop.nest
            positioner.move(stop, 60.0)
        shares.append(100 * (clock.monotonic_s() - own_s) / own_s)
    text = spread(shares, " %")
    _say(OVERHEAD, "handshake with a PLC over the drive's own time, 24 positions", text, "≤ 2 %", max(shares) <= 2.0)


def _say(row: int, what: str, text: str, goal: str, reached: bool) -> None:
    print(f"{'reached' if reached else 'MISSED '}  {what}: {text}; goal {goal}")
    keep(row, what, text, "simulated PLC on virtual time", goal, reached)


PARTS: dict[str, Callable[[argparse.Namespace], None]] = {
    "faults": faults,
    "crashes": crashes,
    "packml": packml,
    "overhead": overhead,
}


def main() -> None:
    """See the top of the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", choices=[[], *PARTS], help="left out: all")
    parser.add_argument("--crashes", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    for name in given.parts or PARTS:
        PARTS[name](given)


if __name__ == "__main__":
    main()
