"""`station rig axes`: the errors of the axes, out of the log of units on a rig that is built a little otherwise."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from station.cli._rig_drives import write_map
from station.cli.app import main
from station.config.rigs import load_rig
from station.config.search_path import shipped_folder
from station.domain.core import rotation
from station.domain.rig.commissioning import with_axes
from tests.fakes import fixture_run

#: The rig as it is really built: outer zero, inner scale, inner axis out of square.
ZERO_DEG, SCALE, SQUARE_DEG = 0.15, 4e-4, -0.2


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the log of two units in half the positions of tilt-24, on a quick rig."""
    folder = tmp_path_factory.mktemp("axes")
    quick = {"speed_deg_s": 720.0, "acceleration_deg_s2": 7200.0, "stop_deg_s2": 7200.0}
    shipped = load_rig("two-axis")
    rig = with_axes(shipped, [axis.model_copy(update=quick) for axis in shipped.axes])
    write_map(folder / "map.yaml", rig)
    outer, inner = rig.axes
    leaning = rotation.about(np.cross(outer.direction, inner.direction), SQUARE_DEG) @ inner.direction
    zero = {"zero_counts": round(outer.zero_counts - ZERO_DEG * outer.counts_per_deg)}
    lean = {"turns": tuple(leaning.tolist()), "counts_per_deg": inner.counts_per_deg / (1 + SCALE)}
    write_map(folder / "built.yaml", with_axes(rig, [outer.model_copy(update=zero), inner.model_copy(update=lean)]))
    positioner = {"kind": "cia402", "map": str(folder / "map.yaml"), "channel": "can1"}
    config = fixture_run.config(folder, positioner=positioner, arrival_tolerance_deg=5.0)
    positions = yaml.safe_load((shipped_folder() / "recipes" / "tilt-24.yaml").read_text())["positions"]
    recipe = fixture_run.recipe(
        folder, "tilt-24", positions=positions[::2], verify=None, runs=[{"seating": "home"}], dwell={"time_s": 0.3}
    )
    ran = fixture_run.run(folder, units=2, config=config, recipe=recipe, mounted=str(folder / "built.yaml"))
    assert ran.fault is None
    return folder


def axes(capsys: pytest.CaptureFixture[str], folder: Path, *args: str) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of the command."""
    config = ("--config", str(folder / "config.yaml"), "--db", str(folder / "station.db"))
    with pytest.raises(SystemExit) as ended:
        main(["rig", "axes", *config, *args])
    out, err = capsys.readouterr()
    return int(ended.value.code or 0), out, err


def test_the_errors_of_the_axes_are_found_and_offered_as_a_correction(
    measured: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    corrected = measured / "corrected.yaml"
    code, out, _ = axes(capsys, measured, "--json", "--correct", str(corrected))
    document = json.loads(out)
    found = {(e["axis"], e["kind"]): e for e in document["errors"]}
    assert code == 1
    assert len(document["units"]) == 2
    for axis, kind, true in (("outer", "zero", ZERO_DEG), ("inner", "scale", SCALE), ("inner", "square", SQUARE_DEG)):
        error = found[axis, kind]
        assert abs(error["value"] - true) < 4 * error["std"] < 0.3 * abs(true), (axis, kind)
    assert {m["id"] for m in document["messages"]} == {"rig-axes-zero", "rig-axes-scale", "rig-axes-square"}
    built, offered = load_rig(str(measured / "built.yaml")), load_rig(str(corrected))
    assert offered.axes[0].zero_counts == pytest.approx(built.axes[0].zero_counts, abs=30)
    assert offered.directions[1] == pytest.approx(built.directions[1], abs=5e-4)


def test_nothing_is_written_where_nothing_was_asked(measured: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = sorted(p.name for p in measured.iterdir())
    code, out, _ = axes(capsys, measured)
    assert code == 1
    assert "U (95 %)" in out
    assert "Axis outer stands +0.1" in out
    assert sorted(p.name for p in measured.iterdir()) == before


@pytest.mark.parametrize(
    ("args", "sentence", "code"),
    [
        (("--since", "2099-01-01"), "No attempt in", 2),
        (("--map", "no-such-rig"), "no-such-rig", 2),
    ],
)
def test_what_says_nothing_of_the_axes_gets_one_sentence(
    measured: Path, capsys: pytest.CaptureFixture[str], args: tuple[str, ...], sentence: str, code: int
) -> None:
    got, out, err = axes(capsys, measured, *args)
    assert (got, out) == (code, "")
    assert sentence in err
    assert len(err.strip().splitlines()) == 1


def test_a_map_of_another_rig_is_no_small_error(measured: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = measured / "other.yaml"
    text = (shipped_folder() / "rigs" / "two-axis.yaml").read_text()
    other.write_text(text.replace("turns: [0, 1, 0]", "turns: [0, 0.7, 0.7]"))
    code, _, err = axes(capsys, measured, "--map", str(other))
    other.unlink()
    assert code == 3
    assert "Commission the rig with `station rig check`" in err
