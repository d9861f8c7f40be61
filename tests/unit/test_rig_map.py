"""The map of a rig: kinematics that come where they are sent, ways that keep out of zones, and refusals."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from station.config.rigs import load_rig
from station.config.search_path import shipped_folder
from station.domain.core import rotation
from station.domain.recipe.position import UP
from station.domain.rig import kinematics, paths
from station.domain.rig.paths import Space, Zone
from station.errors import ConfigError

SHIPPED = shipped_folder() / "rigs" / "two-axis.yaml"
DOCUMENT: dict[str, Any] = yaml.safe_load(SHIPPED.read_text())
VERTICAL = UP["+z"]


def write(folder: Path, change: dict[str, Any], axis: dict[str, Any] | None = None) -> str:
    """The shipped map with blocks changed, and keys of its outer axis."""
    axes = [{**DOCUMENT["axes"][0], **(axis or {})}, DOCUMENT["axes"][1]]
    path = folder / "rig.yaml"
    path.write_text(yaml.safe_dump({**DOCUMENT, "axes": axes, **change}))
    return str(path)


@pytest.mark.parametrize(
    ("change", "axis", "sentence"),
    [
        ({}, {"limits_deg": [90, -90]}, "limits_deg [90, -90] are inside out"),
        ({"park_deg": [400, 0]}, {}, "lies outside its limits"),
        ({"park_deg": [0]}, {}, "1 angles for 2 axes"),
        ({"forbidden": [{"name": "door", "ranges": {"outer": [-5, 5]}}]}, {}, "park_deg lies in forbidden zone 'door'"),
        ({"forbidden": [{"name": "door", "ranges": {"outer": [80, 60]}}]}, {}, "is inside out"),
        ({"forbidden": [{"name": "door", "ranges": {"tilt": [60, 80]}}]}, {}, "names axis 'tilt'"),
        ({"forbidden": [{"name": "door", "ranges": {}}]}, {}, "would forbid everything"),
        ({"station_node": 1}, {}, "is the node of an axis"),
        ({}, {"turns": [0.01, 1, 0]}, "from parallel"),
        ({}, {"counts_per_deg": 0}, "is no scale"),
        ({}, {"counts_per_deg": 1e7}, "beyond the 32 bits"),
        ({}, {"window_deg": 1e-5}, "less than one count"),
        ({}, {"axis": 1}, "give each its own"),
        ({}, {"without": [0x607D]}, "0x607D cannot be left out"),
        (
            {"forbidden": [{"name": "door", "ranges": {"inner": [60, 80]}}]},
            {"homing": {"method": 17, "fast_deg_s": 10, "slow_deg_s": 2, "acceleration_deg_s2": 50}},
            "may pass through zone 'door'",
        ),
    ],
)
def test_a_map_that_cannot_be_safe_is_refused(
    tmp_path: Path, change: dict[str, Any], axis: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(ConfigError) as refused:
        load_rig(write(tmp_path, change, axis))
    assert sentence in refused.value.sentence
    assert "rig.yaml" in refused.value.sentence


@pytest.mark.parametrize("name", ["two-axis", "two-axis-homing"])
def test_every_shipped_rig_brings_every_face_up_in_full_attitude(name: str) -> None:
    rig = load_rig(name)
    for up, axis in UP.items():
        nest = rotation.shortest(axis, VERTICAL)
        goals = rig.goals(nest)
        assert goals, up
        for goal in goals:
            assert np.allclose(rig.attitude(goal), nest, atol=1e-9)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1))
def test_any_two_axes_bring_any_reachable_direction_up(seed: int) -> None:
    rng = np.random.default_rng(seed)
    axes = [v / np.linalg.norm(v) for v in rng.normal(size=(2, 3))]
    if np.linalg.norm(np.cross(*axes)) < 0.2:
        return
    true = rng.uniform(-180, 180, 2)
    nest = kinematics.attitude(axes, true.tolist())
    found = kinematics.poses(axes, nest, 0.001)
    assert found
    assert found[0].yaw_deg < 1e-4, "the full attitude comes first where it can be had"
    for pose in found:
        up = kinematics.attitude(axes, pose.angles_deg).T @ VERTICAL
        assert np.allclose(up, nest.T @ VERTICAL, atol=1e-6)


def _meets(zones: Sequence[Zone], start: paths.Angles, goal: paths.Angles, rng: np.random.Generator) -> bool:
    """Whether axes that start and run as they like between two points can be in a zone: tried at random."""
    shares = np.sort(rng.uniform(size=(200, 2)), axis=0)
    rng.shuffle(shares[:, 1])
    points = np.array(start) + shares * (np.array(goal) - np.array(start))
    return any(zone.meets(tuple(p), tuple(p)) for p in points.tolist() for zone in zones)


@pytest.mark.parametrize("seed", range(12))
def test_ways_keep_out_of_zones_however_the_axes_run(seed: int) -> None:
    rng = np.random.default_rng(seed)
    low = rng.uniform(-150, 120, (3, 2))
    zones = tuple(
        Zone(f"zone {i}", tuple((float(a), float(a + w)) for a, w in zip(corner, rng.uniform(10, 50, 2), strict=True)))
        for i, corner in enumerate(low)
    )
    space = Space(((-180.0, 180.0), (-180.0, 180.0)), zones, (90.0, 90.0), (180.0, 180.0))
    found = 0
    for start, goal in rng.uniform(-180, 180, (8, 2, 2)).tolist():
        if space.zone_at(tuple(start)) or space.zone_at(tuple(goal)):
            continue
        way = paths.safe_way(space, tuple(start), [tuple(goal)])
        if way is None:
            continue
        found += 1
        at = tuple(start)
        for point in way[1]:
            assert not _meets(zones, at, point, rng)
            at = point
        assert at == tuple(goal)
        assert way[0] >= space.hop_s(tuple(start), tuple(goal)) - 1e-9
    assert found, f"seed {seed}: no way at all was tried"


def test_a_zone_across_the_whole_travel_leaves_no_way() -> None:
    space = Space(((-180.0, 180.0),), (Zone("wall", ((10.0, 20.0),)),), (90.0,), (180.0,))
    assert paths.safe_way(space, (0.0,), [(90.0,)]) is None
    way = paths.safe_way(space, (0.0,), [(90.0,), (-90.0,)])
    assert way is not None
    assert way[0] == pytest.approx(1.5)
    assert way[1] == ((-90.0,),)


def test_what_is_wrong_is_named_by_line_and_key(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(SHIPPED.read_text().replace("limits_deg: [-185, 275]", "limits_deg: [9, 3]", 1))
    with pytest.raises(ConfigError, match=r"line 14, key `axes\.0\.limits_deg`: .* inside out"):
        load_rig(str(tmp_path / "map.yaml"))
    zone = "forbidden:\n  - {name: door, ranges: {outer: [80, 60]}}\n"
    (tmp_path / "map.yaml").write_text(SHIPPED.read_text() + zone)
    with pytest.raises(ConfigError, match=r"line 27, key `forbidden\.0\.ranges\.outer`: .* inside out"):
        load_rig(str(tmp_path / "map.yaml"))


def test_axes_that_are_wrong_are_not_called_missing_too(tmp_path: Path) -> None:
    axes = [{**axis, "limits_deg": [90, -90]} for axis in DOCUMENT["axes"]]
    with pytest.raises(ConfigError) as refused:
        load_rig(write(tmp_path, {"axes": axes}))
    assert "at least" not in refused.value.sentence
    assert refused.value.sentence.count("inside out") == 2
