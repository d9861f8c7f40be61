"""`station check` says before anything is measured which causes a recipe cannot tell apart."""

import json
from typing import Any

import pytest

from station.cli.app import main


def checked(recipe: str, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    with pytest.raises(SystemExit) as ended:
        main(["check", recipe, "--json"])
    assert ended.value.code == 0
    causes = json.loads(capsys.readouterr().out)["causes"]
    return {c["effect"]: c for c in causes["causes"]} | {"hidden": causes["not_testable"]}


def test_six_faces_leave_the_classic_ties(capsys: pytest.CaptureFixture[str]) -> None:
    causes = checked("six-point", capsys)
    assert causes["quadratic"]["cannot_tell_from"] == ["asymmetry"]
    assert "package-rotation" in causes["nest-tilt"]["cannot_tell_from"]
    assert {"cubic", "cross-quadratic", "local-gravity"} <= set(causes["hidden"])


def test_three_varied_runs_of_tilts_tell_them_apart(capsys: pytest.CaptureFixture[str]) -> None:
    causes = checked("tilt-24", capsys)
    for effect in ("nest-tilt", "hysteresis", "warm-up", "cross-quadratic"):
        assert causes[effect]["cannot_tell_from"] == [], effect
    # Each run has its own temperature and its own power-on, so another offset in each may be either's.
    assert causes["offset-temperature"]["cannot_tell_from"] == ["turn-on-offset"]
    assert "local-gravity" in causes["hidden"]


def test_what_is_still_seen_after_a_settling_time_is_not_called_hidden(capsys: pytest.CaptureFixture[str]) -> None:
    """0.3 s after arrival a settling of 0.1 s is gone, one of half a second is not."""
    causes = checked("six-point", capsys)
    assert not {"settling", "filter-lag", "lever-arm"} & set(causes["hidden"])
    assert causes["settling"]["cannot_tell_from"] == ["filter-lag"]
