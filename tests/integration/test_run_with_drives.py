"""`station run` with a fixture that simulated drives turn: the same adapter and frames as with real ones."""

from pathlib import Path

import pytest

from station.config.search_path import shipped_folder
from station.domain.core.types import Outcome
from station.domain.run.progress import VisitDone
from station.errors import ConfigError, PositionerFault
from tests.fakes import fixture_run


def test_a_fixture_of_drives_comes_to_pass(tmp_path: Path) -> None:
    config = fixture_run.config(tmp_path, positioner={"kind": "cia402", "map": "two-axis", "channel": "can1"})
    ran = fixture_run.run(tmp_path, units=2, config=config)
    assert ran.fault is None
    assert [r.outcome for r in ran.results.values()] == [Outcome.PASS] * 2
    assert all(r.written and r.verified for r in ran.results.values())
    assert len(ran.of(VisitDone)) == 8
    assert ran.parked
    assert any("positioner cia402 at can1 is not commanded" in notice for notice in ran.notices)


def test_a_nest_with_the_node_of_a_drive_is_refused(tmp_path: Path) -> None:
    config = fixture_run.config(tmp_path, positioner={"kind": "cia402"}, nests=[{"name": "A", "node": 1}])
    with pytest.raises(ConfigError, match="Node 1 is both nest A and inner of rig two-axis"):
        fixture_run.run(tmp_path, config=config)


def test_a_position_beyond_the_limits_is_refused_before_anything_moves(tmp_path: Path) -> None:
    narrow = tmp_path / "narrow.yaml"
    text = (shipped_folder() / "rigs" / "two-axis.yaml").read_text()
    narrow.write_text(text.replace("[-185, 275]", "[-95, 95]"))
    config = fixture_run.config(tmp_path, positioner={"kind": "cia402", "map": str(narrow)})
    with pytest.raises(PositionerFault, match=r"cannot bring position .* up within the limits"):
        fixture_run.run(tmp_path, config=config)
