"""What can be wrong with a simulated drive, in its text form: `KIND` or `KIND:axis=1,after_s=0.3`."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from station.errors import UsageError

#: kind → what is wrong. `after_s` counts from the beginning of a move where the sentence says "in a move".
KINDS: Mapping[str, str] = MappingProxyType(
    {
        "mode-refused": "refuses to change the mode of operation",
        "mode-ignored": "takes a mode of operation and stays in the old one",
        "mode-lag": "shows a new mode of operation 0.3 s late",
        "sdo-silent": "answers no SDO request from some point in a move on",
        "sdo-refuses-target": "refuses the target position",
        "target-changed": "keeps another target position than was written",
        "stale-target": "has an old target position and turns to it as soon as it is enabled",
        "emergency": "reports an over-current in a move and stops in fault",
        "following-error": "cannot follow in a move and stops in fault",
        "limit-switch": "meets a limit switch in a move and stops",
        "safe-torque-off": "loses its torque in a move because somebody opened the guard",
        "safe-torque-off-before": "has its torque off from the start",
        "heartbeat-stops": "sends no heartbeat from some point in a move on",
        "brown-out": "restarts in a move because its supply dipped",
        "power-lost": "is without power from some point in a move on",
        "status-frozen": "sends the same statusword and position for ever from some point in a move on",
        "status-silent": "sends no process data from some point in a move on",
        "reached-early": "reports target reached before it has acknowledged the set-point",
        "reached-outside": "reports target reached and stands half a degree away",
        "acknowledge-missing": "never acknowledges a set-point, and does not move",
        "acknowledge-stuck": "never takes its acknowledge back",
        "jammed": "acknowledges and does not move",
        "slow": "moves at a fiftieth of its speed",
        "wrong-way": "turns the wrong way",
        "runaway": "does not stop at its target",
        "creeps": "creeps on after it has reported target reached",
        "homing-fails": "reports a homing error",
        "homing-endless": "never finds its home",
        "homing-pretended": "says at once that homing is attained, and did not move",
        "homing-elsewhere": "ends its homing with another position than its home offset",
        "enable-refused": "stays in `switched on`",
        "fault-at-enable": "goes into fault when it is enabled",
        "fault-before": "is in fault from the start",
        "enabled-before": "is enabled by somebody else from the start",
        "switches-off": "goes to `switch on disabled` by itself in a move",
        "quick-stops": "stops by itself in a move",
        "local": "is under local control (statusword bit 9 is 0)",
        "no-supply": "has no power-stage supply (statusword bit 4 is 0)",
        "limits-refused": "refuses its software limits",
        "watch-refused": "refuses to watch the station's heartbeat",
        "watch-missing": "takes the heartbeat to watch and keeps nothing of it",
        "other-type": "is a drive of another type",
        "halt-ignored": "does not stop at a halt or a quick stop, only when its power stage goes off",
        "slips": "loses counts between two moves",
        "speaks-after-stop": "needs 0.5 s longer than usual for every answer",
        "second-master": "is switched off by another master in a move",
    }
)


#: How long into a move a fault begins where its text does not say so, s.
AFTER_S = 0.3


@dataclass(frozen=True, slots=True)
class DriveFault:
    """kind: of KINDS; axis: of the node; after_s: how long into a move; move: which move, from 1."""

    kind: str
    axis: int = 0
    after_s: float = AFTER_S
    move: int = 1


def parse(text: str) -> DriveFault:
    """A fault from its text. Errors: UsageError."""
    kind, _, rest = text.partition(":")
    if kind not in KINDS:
        raise UsageError("drive-fault-unknown", kind=kind[:40], known=tuple(KINDS))
    given: dict[str, float] = {}
    for key, _, value in (part.partition("=") for part in rest.split(",") if part):
        try:
            given[key] = float(value)
        except ValueError:
            raise UsageError("drive-fault-option", fault=text[:60], option=key[:40]) from None
        if key not in ("axis", "after_s", "move") or not 0 <= given[key] < 1e6:
            raise UsageError("drive-fault-option", fault=text[:60], option=key[:40])
    return DriveFault(kind, int(given.get("axis", 0)), given.get("after_s", AFTER_S), int(given.get("move", 1)))
