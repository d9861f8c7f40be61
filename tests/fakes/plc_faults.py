"""Every fault of a PLC that concerns a move, what must come of it, and a rig that finds motions nobody commanded."""

from dataclasses import dataclass

import numpy as np

from station.adapters.clock import VirtualClock
from station.adapters.modbus import PlcLink
from station.adapters.positioner.plc import PlcPositioner
from station.adapters.simulated_plc import MemoryRegisters, SimulatedPlc, parse_fault
from station.domain.cell import plc_view
from station.domain.cell.register_map import RegisterMap
from station.domain.core import rotation
from station.domain.recipe.plan import PlannedVisit
from station.domain.recipe.position import UP
from station.errors import PositionerFault

#: After a fault the fixture may run on for so long: the PLC's watch of the station, s.
RUN_ON_S = 0.55
#: fault → id of the sentence that must come of the third move, '' where the move must succeed.
EXPECTED = {
    "killed:at=3": "plc-not-reached",
    "killed:at=0": "plc-not-reached",
    "silent:at=3": "plc-lost",
    "late:at=3": "plc-lost",
    "slow:at=3": "",
    "dropped:at=3": "",
    "exception:at=3": "plc-exception",
    "garbage:at=3": "plc-lost",
    "restarted:at=3": "plc-restarted",
    "frozen:at=3": "plc-heartbeat-stale",
    "heartbeat-stale:at=3": "plc-heartbeat-stale",
    "other-protocol:at=0": "plc-protocol",
    "other-protocol:at=3": "plc-protocol",
    "unknown-bits:at=0": "plc-unknown-bits",
    "unknown-bits:at=3": "plc-unknown-bits",
    "ignores-offer:at=3": "plc-no-echo",
    "stale-echo:at=3": "plc-echo-differs",
    "other-number:at=3": "plc-no-echo",
    "wrong-target:at=3": "plc-echo-differs",
    "echo-changes:at=3": "plc-target-changed",
    "refused:at=3": "plc-refused",
    "write-lost:at=3": "plc-write-lost",
    "never-starts:at=3": "plc-not-started",
    "go-delayed:at=3": "plc-not-started",
    "stuck:at=3": "positioner-timed-out",
    "crawls:at=3": "positioner-timed-out",
    "done-early:at=3": "plc-done-elsewhere",
    "moves-unasked:at=3": "plc-moves-unasked",
    "door-open:at=3": "plc-door-open",
    "door-opened:at=3": "plc-door-open",
    "clamp-open:at=3": "plc-clamps-open",
    "clamp-opened:at=3": "plc-clamps-open",
    "safety-tripped:at=3": "plc-safety-tripped",
    "part-removed:at=3": "plc-part-gone",
}


def stop(up: str) -> PlannedVisit:
    """A stop with that axis up."""
    nest = rotation.shortest(UP[up], UP["+z"])
    return PlannedVisit(0, 0, up, "home", nest, np.eye(3), nest.T @ UP["+z"], None)


@dataclass(frozen=True, slots=True)
class Tried:
    """What came of three moves: id of the third's sentence, sentence, and how far the fixture was off when "arrived"
    was said, degrees; uncommanded: seconds of motion to another target, or beyond the end of its move and RUN_ON_S."""

    id: str
    sentence: str
    off_deg: float
    uncommanded_s: float


def attempt(fault: str, axes: tuple[str, ...] = ("+x", "-y", "-z"), wait_s: float = 5.0) -> Tried:
    """Three moves, the third with the fault; then the station is silent for a while."""
    clock, plc_map = VirtualClock(), RegisterMap()
    plc = SimulatedPlc(plc_map, faults=[parse_fault(fault)])
    link = PlcLink(MemoryRegisters(plc, clock), plc_map, clock)
    positioner = PlcPositioner(PlcPositioner.Settings(host="simulated"), clock, link)
    calls: list[tuple[tuple[int, ...], float, float]] = []
    found, sentence, worst = "", "", 0.0
    for up in axes:
        goal, began_s = stop(up).nest, clock.monotonic_s()
        try:
            positioner.move(stop(up), 6.0)
            off = np.linalg.norm(rotation.to_vector(plc.attitude(clock.monotonic_s()) @ goal.T))
            worst = max(worst, float(np.rad2deg(off)))
        except PositionerFault as fault_:
            found, sentence = fault_.message.id, fault_.sentence
        calls.append((plc_view.quaternion_of(goal), began_s, clock.monotonic_s()))
        if found:
            break
        clock.sleep(0.3)
    for _ in range(round(wait_s / 0.1)):
        clock.sleep(0.1)
        plc.scan(clock.monotonic_s())
    return Tried(found, sentence, worst, sum(_uncommanded_s(motion, calls) for motion in plc.motions))


def _uncommanded_s(motion: object, calls: list[tuple[tuple[int, ...], float, float]]) -> float:
    from station.adapters.simulated_plc import Motion

    assert isinstance(motion, Motion)
    allowed = [c for c in calls if c[0] == motion.target and c[1] <= motion.began_s <= c[2]]
    if not allowed:
        return motion.until_s - motion.began_s
    return max(0.0, motion.until_s - allowed[0][2] - RUN_ON_S)
