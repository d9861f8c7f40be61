"""A station that is killed leaves a rig that stands within half a second, and the next one begins safely.

Every frame of a life is killed at in tests/endurance/torture_rig.py.
"""

from pathlib import Path

import pytest

from station.config.search_path import shipped_folder
from station.domain.rig.drive_profile import DriveState
from tests.fakes.driven_rig import STOP_ID, DrivenRig, frames_of_a_life, killed_life

_FRAMES = frames_of_a_life("two-axis")
_STOP = [can_id for can_id, _ in _FRAMES].index(STOP_ID)


@pytest.mark.parametrize("frame", [*range(20, len(_FRAMES), 75), _STOP + 1, _STOP + 2, _STOP + 3])
def test_killed_at_a_frame_of_prepare_move_halt_and_park(frame: int) -> None:
    assert killed_life("two-axis", frame) == ""


@pytest.mark.parametrize("frame", [420])
def test_killed_while_it_homes(frame: int) -> None:
    assert killed_life("two-axis-homing", frame) == ""


def test_the_stop_is_the_very_next_frame_and_one_sync_serves_both_axes() -> None:
    after = _FRAMES[_STOP + 1 : _STOP + 4]
    assert after == [(0x201, b"\x02\x00"), (0x301, b"\x02\x00"), (0x080, b"")]


def test_an_axis_with_a_brake_has_no_power_between_two_moves(tmp_path: Path) -> None:
    shipped = (shipped_folder() / "rigs" / "two-axis.yaml").read_text()
    braked = tmp_path / "braked.yaml"
    braked.write_text(shipped.replace("    limits_deg:", "    hold: brake\n    limits_deg:"))
    rig = DrivenRig(str(braked))
    for up in ("-y", "+x"):
        assert rig.move(up) is None
        assert {drive.state for drive in rig.positioner.link.drives} == {DriveState.DISABLED}
        assert rig.stands()
