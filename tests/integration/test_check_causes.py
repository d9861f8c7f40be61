"""`station check` says before anything is measured which causes a recipe cannot tell apart."""

import json
from pathlib import Path
from typing import Any

import pytest

from station.cli.app import main
from station.config.search_path import shipped_folder


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
    # By what a thermometer may err, a rate of temperature could follow anything; as the rate of one exponential it is
    # what the slow causes do in a run of half a minute.
    like_a_rate = {e for e, c in causes.items() if e != "hidden" and "temperature-rate" in c["cannot_tell_from"]}
    assert like_a_rate <= {"bias-drift", "clamp-creep", "offset-temperature", "warm-up"}
    assert {"cubic", "cross-quadratic", "local-gravity"} <= set(causes["hidden"])


def test_three_varied_runs_of_tilts_tell_them_apart(capsys: pytest.CaptureFixture[str]) -> None:
    causes = checked("tilt-24", capsys)
    for effect in ("nest-tilt", "hysteresis", "warm-up", "cross-quadratic"):
        assert causes[effect]["cannot_tell_from"] == [], effect
    # Each run has its own temperature and its own power-on, so another offset in each may be either's.
    assert causes["offset-temperature"]["cannot_tell_from"] == ["turn-on-offset"]
    assert "local-gravity" in causes["hidden"]


@pytest.mark.parametrize("step", ["6.25e-5", "0"])
def test_a_device_stated_without_noise_is_checked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], step: str
) -> None:
    text = (shipped_folder() / "recipes" / "six-point.yaml").read_text(encoding="utf-8")
    for stated, instead in (("noise_density: 0.0001", "noise_density: 0"), ("lsb: 6.25e-5", f"lsb: {step}")):
        assert stated in text
        text = text.replace(stated, instead)
    (tmp_path / "still.yaml").write_text(text.replace("product: accelerometer", "# none"), encoding="utf-8")
    assert "asymmetry" in checked(str(tmp_path / "still.yaml"), capsys)["quadratic"]["cannot_tell_from"]


def test_what_is_still_seen_after_a_settling_time_is_not_called_hidden(capsys: pytest.CaptureFixture[str]) -> None:
    """0.3 s after arrival a settling of 0.1 s is gone, one of half a second is not."""
    causes = checked("six-point", capsys)
    assert not {"settling", "filter-lag", "lever-arm"} & set(causes["hidden"])
    assert causes["settling"]["cannot_tell_from"] == ["filter-lag"]
