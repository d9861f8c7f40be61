"""Languages, the picture of the fixture, and how a run is found by its lock."""

import json
import os
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from station.domain.core import rotation
from station.messages import labels
from station.panel_protocol.owner import owner_pid
from station.reporting.drawing import fixture
from station.web.run_launcher import LaunchOptions, RunLauncher


def test_every_language_says_everything_and_nothing_more() -> None:
    texts = labels.all_texts()
    assert set(texts) == {"en", "de", "zh"}
    for code, printed in texts.items():
        assert set(printed) == set(texts["en"]), code
        assert all(printed.values()), code
        assert not set(printed) & set(dir(dict)), "a template would find the mapping's own method"


def faces(pose: np.ndarray) -> set[str]:
    """The names on the faces that are seen."""
    drawn = ElementTree.fromstring(fixture.picture(pose.tolist(), "p"))
    return {t.text or "" for t in drawn.iter("{http://www.w3.org/2000/svg}text")} - {"z"}


def test_the_block_shows_the_faces_that_a_person_in_front_sees() -> None:
    assert faces(np.eye(3)) == {"−y", "+z", "+x"}
    assert "−z" in faces(rotation.about(np.array([1.0, 0, 0]), 180.0))
    x_up = rotation.shortest(np.array([1.0, 0, 0]), np.array([0, 0, 1.0]))
    assert {"+x", "−y"} <= faces(x_up)


def _towards_viewer(axis: np.ndarray) -> np.ndarray:
    """The direction across an axis that comes nearest to the viewer's."""
    viewer = fixture._VIEW.T @ np.array([0.0, -1.0, 0.0])
    unit = axis / np.linalg.norm(axis)
    return np.asarray(viewer - (viewer @ unit) * unit)


@pytest.mark.parametrize("axis", [(0, 0, 1), (1, 0, 0), (0, 1, 0), (0, 0.55, 0.85), (1, 1, 1)])
@pytest.mark.parametrize("angle_deg", [45.0, -45.0, 90.0, -90.0, 180.0])
def test_an_arrow_shows_which_way_a_person_turns_the_unit(axis: tuple[float, ...], angle_deg: float) -> None:
    turned = rotation.about(np.array(axis), angle_deg)
    drawn = ElementTree.fromstring(fixture.picture(np.eye(3).tolist(), "p", turned.tolist()))
    line = next(n for n in drawn.iter("{http://www.w3.org/2000/svg}polyline")).get("points", "")
    way = np.array([[float(v) for v in point.split(",")] for point in line.split()])
    assert ((way > 0) & (way < 220)).all(), "within the picture"
    # Seen from the viewer the way is convex and goes round as the nearest point of the rotation does.
    front = _towards_viewer(np.array(axis, float))
    ahead = rotation.about(np.array(axis), float(np.sign(angle_deg))) @ front - front
    if abs(angle_deg) < 180:  # a half turn is the same either way
        assert (way[-1] - way[0]) @ (fixture._project(ahead) - fixture._project(np.zeros(3))) > 0
    assert "polyline" not in fixture.picture(np.eye(3).tolist(), "p", np.eye(3).tolist())


def test_names_cannot_break_out_of_the_picture() -> None:
    assert "<script" not in fixture.picture(None, "<script>")
    assert ">?<" in fixture.picture(None, "anything")


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"pid": "x"}', '{"pid": 999999999}'])
def test_a_lock_that_nobody_holds_is_no_owner(tmp_path: Path, text: str) -> None:
    (tmp_path / "s.db.lock").write_text(text)
    assert owner_pid(tmp_path / "s.db") is None


def test_a_pid_counts_only_while_it_has_the_lock_open(tmp_path: Path) -> None:
    lock = tmp_path / "s.db.lock"
    lock.write_text(json.dumps({"pid": os.getpid()}))
    assert owner_pid(tmp_path / "s.db") is None, "this process is alive, but does not hold it"
    with lock.open():
        assert owner_pid(tmp_path / "s.db") == os.getpid()
        assert RunLauncher(LaunchOptions(tmp_path / "s.db", "six-point")).pid() == os.getpid()


def test_words_of_a_run_cannot_be_taken_for_options(tmp_path: Path) -> None:
    words = LaunchOptions(tmp_path / "s.db", "six-point", simulate=True, pace=2.0).words({"B": "--version"}, "anna")
    assert words[-2:] == ["--nest=B", "--serial=--version"]
    assert "--operator=anna" in words


def test_a_load_gets_the_faults_of_its_own_units(tmp_path: Path) -> None:
    faults = ("SN2/stuck-axis:value=2", "save-torn", "SN1/silent", "BUS/jammed")
    words = LaunchOptions(tmp_path / "s.db", "six-point", simulate=True, faults=faults).words({"A": "SN1"}, "anna")
    given = [word.removeprefix("--fault=") for word in words if word.startswith("--fault=")]
    assert given == ["save-torn", "SN1/silent", "BUS/jammed"]
