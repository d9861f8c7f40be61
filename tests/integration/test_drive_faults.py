"""Drives with faults: nothing moves unasked, nothing is called arrived that is not there, and the sentence is right."""

import numpy as np
import pytest

from station.adapters.simulated_device.drive.drive_fault import KINDS
from tests.fakes.driven_rig import DrivenRig, visit

HOMING = "two-axis-homing"
#: kind → the message of the move that meets it (None: the move succeeds all the same).
OUTCOMES: dict[str, str | None] = {
    "mode-refused": "drive-sdo-failed",
    "mode-ignored": "drive-mode-refused",
    "mode-lag": None,
    "sdo-silent": "drive-not-stopped",
    "sdo-refuses-target": "drive-sdo-failed",
    "target-changed": "drive-keeps-other",
    "stale-target": None,
    "emergency": "drive-stopped",
    "following-error": "drive-stopped",
    "limit-switch": "drive-at-limit",
    "safe-torque-off": "drive-stopped",
    "safe-torque-off-before": "drive-torque-off",
    "heartbeat-stops": "drive-heartbeat-silent",
    "brown-out": "drive-restarted",
    "power-lost": "drive-not-stopped",
    "status-frozen": "positioner-timed-out",
    "status-silent": "drive-status-silent",
    "reached-early": None,
    "reached-outside": "drive-outside-window",
    "acknowledge-missing": "drive-not-acknowledged",
    "acknowledge-stuck": "drive-acknowledge-stays",
    "jammed": "drive-outside-window",
    "slow": "positioner-timed-out",
    "wrong-way": "drive-off-way",
    "runaway": "drive-not-stopped",
    "creeps": "drive-outside-window",
    "homing-fails": "homing-failed",
    "homing-endless": "homing-endless",
    "homing-pretended": "homing-not-begun",
    "homing-elsewhere": "homing-elsewhere",
    "enable-refused": "drive-stays",
    "fault-at-enable": "drive-stays",
    "fault-before": "drive-in-fault",
    "enabled-before": "drive-enabled-elsewhere",
    "switches-off": "drive-stopped",
    "quick-stops": "drive-stopped",
    "local": "drive-local",
    "no-supply": "drive-stays",
    "limits-refused": "drive-sdo-failed",
    "watch-refused": "drive-sdo-failed",
    "watch-missing": "drive-keeps-other",
    "other-type": "drive-other-type",
    "halt-ignored": None,
    "slips:after_s=1.8": "drive-slipped",
    "speaks-after-stop": "drive-not-stopped",
    "second-master": "drive-stopped",
}
#: Faults in which the drive itself turns where it was not sent: so far it may come before it stands, degrees.
DRIVES_ASTRAY = {"wrong-way": 6.0, "runaway": 45.0, "creeps": 2.0, "slips": 6.0, "homing-endless": 460.0}
HOMES = ("homing", "safe-torque-off")


def test_every_fault_has_its_outcome() -> None:
    assert {kind.partition(":")[0] for kind in OUTCOMES} == set(KINDS)


@pytest.mark.parametrize("kind", OUTCOMES)
def test_a_fault_has_its_outcome_and_moves_nothing(kind: str) -> None:
    plain = kind.partition(":")[0]
    rig = DrivenRig(HOMING if plain.startswith(HOMES) else "two-axis", [kind])
    wanted = OUTCOMES[kind]
    # The first move turns one axis alone; the second one both, and meets the fault of the outer one.
    for up in ("-y", "+x"):
        fault = rig.move(up)
        if fault is not None:
            break
        arrived = rig.positioner.rig.goals(visit(up).nest)
        off_deg = min(float(np.abs(rig.truth_deg() - goal).max()) for goal in np.array(arrived))
        assert off_deg <= rig.map.axes[0].window_deg, "arrived, but it is not there"
        rig.clock.sleep(0.5)
    assert (fault.message.id if fault else None) == wanted
    if fault is not None:
        assert "=" not in fault.sentence.replace("==", "")
        again = rig.park()
        assert again is not None, "parked after a fault"
        assert again.message.id == "rig-left-standing"
    rig.clock.sleep(0.5)
    assert rig.stands()
    assert rig.witness.excess_deg <= DRIVES_ASTRAY.get(plain, 0.5)
    assert rig.witness.unasked_s <= (0.05 if plain in DRIVES_ASTRAY else 0.0)
