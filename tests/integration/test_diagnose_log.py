"""`station diagnose` on what the station itself has kept: its log, from a day or a time on, and recorded CAN logs."""

import json
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
import yaml

from station.cli._log_options import parse_span_ns
from station.config.recipes import recipe_path
from tests.fakes.command import station

pytestmark = pytest.mark.timeout(300)


@dataclass(frozen=True)
class Stored:
    """A log of two loads in tilted nests, the recipe, and when the first load was over."""

    db: str
    recipe: str
    between: str


#: How the nests are tilted, rad.
TILTED = {"nest:A": (0.002, -0.001, 0.0015), "nest:B": (-0.0005, 0.002, -0.001)}


def rig(folder: Path) -> str:
    """The rig as a model file, which is the same whatever the seed of the noise."""
    rows = [
        {"name": "angle", "axis": axis, "of": nest, "value": value, "unit": "rad"}
        for nest, angle in TILTED.items()
        for axis, value in zip("xyz", angle, strict=True)
    ]
    path = folder / "rig.yaml"
    path.write_text(
        yaml.safe_dump({"schema": "station.model/1", "effects": [{"effect": "nest-tilt", "parameters": rows}]}),
        encoding="utf-8",
    )
    return str(path)


def two_runs(folder: Path) -> str:
    """The 24 tilts gone through at home and turned, without the ten minutes of warming."""
    printed = yaml.safe_load(recipe_path("tilt-24").read_text(encoding="utf-8"))
    printed["runs"] = [{"seating": "home"}, {"seating": "turned", "order": "reversed"}]
    printed["dwell"] = {"time_s": 0.5}
    path = folder / "tilts.yaml"
    path.write_text(yaml.safe_dump(printed), encoding="utf-8")
    return str(path)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Stored:
    folder = tmp_path_factory.mktemp("kept")
    recipe, db = two_runs(folder), str(folder / "station.db")
    requested = ("--recipe", recipe, "--simulate", "--model", rig(folder), "--db", db)
    assert station("run", *requested, "--seed", "1", "--serial", "SN0001", "--serial", "SN0002") == 0
    between = datetime.now().astimezone().isoformat()
    assert station("run", *requested, "--seed", "2", "--serial", "SN0003", "--serial", "SN0004") == 0
    return Stored(db, recipe, between)


def shown(stored: Stored, capsys: pytest.CaptureFixture[str], *requested: str) -> dict[str, Any]:
    capsys.readouterr()
    assert station("diagnose", "--recipe", stored.recipe, *requested, "--json", "-") == 1
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def check(document: dict[str, Any], names: tuple[str, str] = ("nest:A", "nest:B")) -> None:
    """Nest tilt and nothing else, the nests' angles within four of their standard deviations."""
    (cause,) = document["causes"]
    assert (document["verdict"], cause["effect"], cause["indistinguishable_from"]) == ("named", "nest-tilt", [])
    assert cause["gain"]["accepted"]
    wanted = {(n, a): v for n, t in zip(names, TILTED.values(), strict=True) for a, v in zip("xyz", t, strict=True)}
    assert {(p["of"], p["axis"]) for p in cause["parameters"]} == set(wanted)
    for p in cause["parameters"]:
        assert abs(p["value"] - wanted[p["of"], p["axis"]]) < 4 * p["std"] < 8e-5


def test_the_log_of_a_run_names_the_nests_that_are_tilted(stored: Stored, capsys: pytest.CaptureFixture[str]) -> None:
    found = shown(stored, capsys, "--db", stored.db, "--since", "1d")
    assert found["data"] == {"units": 4, "runs": 8, "visits": 192, "samples": 9600}
    check(found)
    assert found["baseline"]["floor_rms"] < 1.3e-4


def test_since_takes_what_began_then_or_later(stored: Stored, capsys: pytest.CaptureFixture[str]) -> None:
    midnight = datetime.now().astimezone().replace(hour=0, minute=0, second=0, microsecond=0)
    assert parse_span_ns(midnight.date().isoformat(), None) == (int(midnight.timestamp()) * 10**9, None)
    late = shown(stored, capsys, "--db", stored.db, "--since", stored.between)
    assert late["data"] == {"units": 2, "runs": 4, "visits": 96, "samples": 4800}
    check(late)


@pytest.mark.parametrize(
    ("since", "printed"),
    [
        ("last week", "--since 'last week' is not a time; write 2026-11-21, 2026-11-21T13:00 or 7d (ago)"),
        ("2026-02-30", "--since '2026-02-30' is not a time"),
        ("", "--since '' is not a time"),
        ("2026", "--since '2026' is not a time"),
        ("2999-01-01", "--since '2999-01-01' is out of range; give a year from 1700 to 2260"),
        ("0001-01-01", "is out of range"),
        ("2199-01-01", "holds no visits of recipe 'tilt-24'"),
    ],
)
def test_no_time_is_a_sentence(since: str, printed: str, stored: Stored, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert station("diagnose", "--recipe", stored.recipe, "--db", stored.db, "--since", since) == 2
    error = capsys.readouterr().err
    assert printed in error
    assert error.count("\n") == 1


def test_since_without_a_log_is_a_sentence(stored: Stored, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert station("diagnose", "--recipe", stored.recipe, "--samples", "s.csv", "--since", "7d") == 2
    assert "--since selects from the station's log: add --db FILE" in capsys.readouterr().err


@pytest.mark.parametrize("ending", ["log", "blf"])
def test_a_recorded_can_log_says_what_the_station_s_log_says(
    ending: str, stored: Stored, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The frames of the second load as `station replay` takes them, marks beside them."""
    frames = str(tmp_path / f"frames.{ending}")
    assert station("export", "--db", stored.db, "--since", stored.between, "--frames", frames) == 0
    assert station("replay", frames, "--recipe", stored.recipe) == 0
    check(shown(stored, capsys, "--samples", frames), ("nest:node-17", "nest:node-18"))


def test_a_healthy_run_is_silent(
    stored: Stored, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    db = str(tmp_path / "station.db")
    assert station("run", "--recipe", stored.recipe, "--simulate", "--units", "2", "--seed", "8", "--db", db) == 0
    capsys.readouterr()
    assert station("diagnose", "--recipe", stored.recipe, "--db", db, "--json", "-") == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["verdict"], found["data"]["units"], found["data"]["runs"]) == ("none", 2, 4)
