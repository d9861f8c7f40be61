"""What a person may hand in wrong: one clear sentence before anything moves, and no attempt in the log."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from station.config.recipes import load_recipe
from station.config.search_path import shipped_folder
from station.config.settings import PositionerSettings
from station.domain.core.types import Outcome
from station.domain.recipe import serial
from station.errors import (
    BusFault,
    ConfigError,
    InputError,
    ProductError,
    RecipeError,
    ReferenceOverdue,
    StationError,
    StoreFault,
    UsageError,
)
from station.model.simulate import SimulationJob
from station.wiring.bench import open_bench
from station.wiring.run_order import RunOrder
from tests.fakes import fixture_run

SIX = [{"name": f, "up": f} for f in ("+z", "-z", "+x", "-x", "+y", "-y")]


def refused(folder: Path, kind: type[StationError] | tuple[type[StationError], ...], **order: object) -> str:
    """Opens the station with an order that cannot be; the sentence. Nothing may be left behind."""
    database = folder / "station.db"
    with pytest.raises(kind) as caught:
        open_bench(RunOrder(**{"simulate": True, "database": database, **order})).close()  # type: ignore[arg-type]
    assert not database.exists(), "no log is begun for what cannot run"
    printed = caught.value.sentence
    assert "\n" not in printed
    assert caught.value.exit_code == (2 if isinstance(caught.value, InputError) else 3)
    return printed


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"dwel": {"time_s": 1.0}}, "unknown key; did you mean `dwell`?"),
        ({"positions": None}, "positions are missing; list at least one"),
        ({"positions": SIX[:5]}, "has 5 positions; list 6"),
        ({"positions": [*SIX, SIX[0]]}, "position '+z' is listed twice"),
        (
            {"positions": [{"name": "a", "quaternion": [1, 1, 0, 0]}, *SIX[1:]]},
            "quaternion is not a rotation: its length",
        ),
        ({"positions": [{"name": "a"}, *SIX[1:]]}, "position 'a' has no orientation"),
        ({"positions": [{"name": "a", "up": "+z", "rotate": []}, *SIX[1:]]}, "both give the orientation"),
        ({"limits": {"offset": -0.1}}, "greater than 0"),
        ({"limits": {"temperature_degC": [40, 10]}}, "is empty; the lower limit"),
        ({"limits": {"rule": "false-accept"}}, "needs false_accept"),
        ({"unit": "m/s2"}, "the nearest is"),
        ({"runs": [{"seating": "upside-down"}]}, "seating 'upside-down' is not defined"),
        ({"product": None}, "names no product"),
        ({"product": "no-such-thing"}, "There is no no-such-thing.yaml"),
        ({"product": "../accelerometer"}, "is not a plain name"),
        ({"dwell": {"time_s": 1, "until_std": 0.001}}, "either time_s or until_std"),
        ({"model": "offset-gain"}, "method six-point finds cross-axis terms whatever the model"),
        ({"method": "n-point", "model": "offset-gain"}, "limits.cross_axis cannot be decided"),
        (
            {"reference": {"source": "gravity", "magnitude": 1, "site": {"latitude_deg": 47, "altitude_m": 0}}},
            "magnitude",
        ),
    ],
)
def test_a_recipe_that_cannot_be_run(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    printed = refused(tmp_path, InputError, recipe=fixture_run.recipe(tmp_path, **changes))
    assert words in printed
    assert (
        "six-point-changed.yaml" in printed or "product" in words or "no-such-thing" in words or "plain name" in words
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"nests": [{"name": "A", "node": 17}, {"name": "B", "node": 17}]}, "both have node 17"),
        ({"nests": []}, "nests"),
        ({"positioner": {"kind": "simulated", "sped_deg_s": 3}}, "did you mean `speed_deg_s`?"),
        ({"positioner": {"kind": "simulated", "speed_deg_s": -3}}, "greater than 0"),
        ({"bus": {"interface": "socketcan", "bitrate": 5}}, "key `bitrate`"),
        ({"bus": {"interface": "socketcan", "bitrat": 500000}}, "did you mean `bitrate`?"),
    ],
)
def test_a_config_that_cannot_be_used(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    printed = refused(tmp_path, ConfigError, config=fixture_run.config(tmp_path, **changes))
    assert words in printed
    assert "config.yaml, line" in printed


def test_an_unknown_positioner_names_the_known_ones(tmp_path: Path) -> None:
    file = fixture_run.config(tmp_path, positioner={"kind": "robot-arm"})
    printed = refused(tmp_path, InputError, config=file, simulate=False, channel="nocan9")
    assert "robot-arm" in printed
    assert all(kind in printed for kind in ("manual", "simulated"))


def test_an_unknown_bus_names_the_known_ones(tmp_path: Path) -> None:
    file = fixture_run.config(tmp_path, bus={"interface": "carrier-pigeon"})
    assert "replay, simulated, socketcan" in refused(tmp_path, ConfigError, config=file)


def test_a_positioner_in_numbers_may_not_turn_real_units(tmp_path: Path) -> None:
    file = fixture_run.config(tmp_path, positioner={"kind": "simulated"})
    assert "turns nothing" in refused(tmp_path, InputError, config=file, simulate=False)


def test_without_a_word_on_it_a_person_turns_the_fixture() -> None:
    assert PositionerSettings().kind == "manual"


def test_an_absent_interface(tmp_path: Path) -> None:
    printed = refused(tmp_path, (ConfigError, BusFault), simulate=False, channel="nocan9")
    assert "nocan9" in printed or "This kernel has no CAN" in printed


def product(folder: Path, change: Callable[[dict[str, Any]], object] = lambda _: None) -> Path:
    """A copy of the shipped product beside a recipe of its own, changed; the recipe's path."""
    shutil.copytree(shipped_folder() / "dbc", folder / "dbc")
    path = folder / "dbc" / "accelerometer.yaml"
    document = yaml.safe_load(path.read_text())
    change(document)
    path.write_text(yaml.safe_dump(document))
    (folder / "recipes").mkdir()
    shutil.copy(shipped_folder() / "recipes" / "six-point.yaml", folder / "recipes")
    return folder / "recipes" / "six-point.yaml"


def test_a_dbc_without_the_mapped_signal(tmp_path: Path) -> None:
    def change(document: dict[str, Any]) -> None:
        document["frames"]["sample"]["x"] = "XX"

    printed = refused(tmp_path, ProductError, recipe=str(product(tmp_path, change)))
    assert "message ACCELERATION has no signal XX; its signals are CRC, COUNTER, STATUS, X, Y, Z" in printed


def test_a_dbc_without_the_mapped_message(tmp_path: Path) -> None:
    recipe = product(tmp_path)
    dbc = tmp_path / "dbc" / "accelerometer.dbc"
    dbc.write_text(dbc.read_text().replace("ACCELERATION", "VELOCITY"))
    assert "has no message ACCELERATION" in refused(tmp_path, ProductError, recipe=str(recipe))


def test_a_dbc_in_a_unit_of_another_quantity(tmp_path: Path) -> None:
    recipe = product(tmp_path)
    dbc = tmp_path / "dbc" / "accelerometer.dbc"
    dbc.write_text(dbc.read_text().replace('"g" STATION', '"bar" STATION'))
    assert "gives readings in 'bar'; the station converts g, m/s²" in refused(
        tmp_path, ProductError, recipe=str(recipe)
    )


def test_a_dbc_that_is_none(tmp_path: Path) -> None:
    recipe = product(tmp_path)
    (tmp_path / "dbc" / "accelerometer.dbc").write_bytes(bytes(range(256)))
    assert "accelerometer.dbc" in refused(tmp_path, ProductError, recipe=str(recipe))


def test_a_product_of_another_sensor(tmp_path: Path) -> None:
    recipe = product(tmp_path, lambda d: d.update(sensor="gyroscope"))
    assert "calibrates the sensor accelerometer, but" in refused(tmp_path, RecipeError, recipe=str(recipe))


@pytest.mark.parametrize(
    ("matrix", "words"), [({"index": 0x2101, "order": "diagonal"}, "stores gains only"), (None, "keeps an offset only")]
)
def test_a_recipe_that_finds_more_than_the_device_keeps(tmp_path: Path, matrix: object, words: str) -> None:
    """Found at the desk: all units would be measured, and each would end at its write."""

    def change(document: dict[str, Any]) -> None:
        document["map"].pop("checksum")
        document["map"].pop("order")
        document["map"].update(matrix=matrix)

    printed = refused(tmp_path, RecipeError, recipe=str(product(tmp_path, change)))
    assert words in printed


def test_an_unknown_key_in_the_device_map(tmp_path: Path) -> None:
    def change(document: dict[str, Any]) -> None:
        document["map"]["matirx"] = document["map"].pop("matrix")

    printed = refused(tmp_path, ProductError, recipe=str(product(tmp_path, change)))
    assert "did you mean `matrix`?" in printed
    assert "accelerometer.yaml, line" in printed


def test_a_simulation_without_an_eds(tmp_path: Path) -> None:
    recipe = product(tmp_path, lambda d: d.pop("eds"))
    assert "names no EDS" in refused(tmp_path, ProductError, recipe=str(recipe))


@pytest.mark.parametrize(
    ("serials", "words"),
    [(["SN0001", "SN0001"], "is listed twice"), (["SN1"], "does not match"), (["SN0001\n"], "printable")],
)
def test_serials_that_cannot_be(tmp_path: Path, serials: list[str], words: str) -> None:
    with (
        open_bench(RunOrder(simulate=True, database=tmp_path / "station.db")) as bench,
        pytest.raises(UsageError) as caught,
    ):
        serial.check_all(serials, bench.job.recipe)
    assert words in caught.value.sentence


def gold(folder: Path, **change: object) -> str:
    shown = {"serial": "G1", "due": "2099-01-31", "node": 5, "seat_std_deg": 0.01, **change}
    reference = {"source": "gold", "magnitude": 1.0, "gold": {k: v for k, v in shown.items() if v is not None}}
    return fixture_run.recipe(folder, reference=reference)


def test_a_reference_past_its_due_date_measures_nothing(tmp_path: Path) -> None:
    printed = refused(tmp_path, ReferenceOverdue, recipe=gold(tmp_path, due="2020-01-31"))
    assert "expired on 2020-01-31" in printed


@pytest.mark.parametrize(("node", "words"), [(None, "gold.node is missing"), (17, "is also the node of nest A")])
def test_a_gold_reference_nobody_can_read(tmp_path: Path, node: int | None, words: str) -> None:
    assert words in refused(tmp_path, RecipeError, recipe=gold(tmp_path, node=node))


def test_a_gold_reference_is_the_truth_and_when_it_dies_nothing_counts(tmp_path: Path) -> None:
    tilted: dict[str, Any] = {"effects": ("base-tilt=0.02",), "recipe": gold(tmp_path)}
    ran = fixture_run.run(tmp_path, **tilted)
    r = ran.results["SN0001"]
    assert r.fit is not None
    assert r.fit.calibration is not None
    # A base that leans by 20 mrad would stand in the offsets of a unit calibrated against nominal poses.
    base = SimulationJob(load_recipe("six-point"), ("SN0001",), 1).base(("SN0001",))
    assert abs(r.fit.calibration.offset - base.offset[0]).max() < 0.001
    blind = fixture_run.run(tmp_path, seed=2, recipe=fixture_run.recipe(tmp_path), effects=("base-tilt=0.02",))
    assert blind.results["SN0001"].outcome is Outcome.FAIL
    dead = fixture_run.run(tmp_path, seed=3, faults=("GOLD/stream-stops:after_s=6",), recipe=gold(tmp_path))
    assert dead.results["SN0001"].outcome is Outcome.ERROR
    shown = dead.results["SN0001"].reasons[0].sentence
    assert "Gold reference G1 (node 5) sent 0 of 100 readings at 'x-up'" in shown


@pytest.mark.parametrize(("where", "what"), [("", "it is a folder"), ("pipe", "it is not a regular file")])
def test_a_log_that_is_no_file(tmp_path: Path, where: str, what: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(StoreFault, match=what):
        open_bench(RunOrder(simulate=True, database=tmp_path / where))
    assert (tmp_path / "pipe").is_fifo(), "nothing takes the place of what is there"


def test_a_fault_of_a_unit_that_is_not_there_is_not_tried_in_vain(tmp_path: Path) -> None:
    from station.cli._run import RunOptions, run_units

    order = RunOrder(simulate=True, database=tmp_path / "station.db", faults=("SN9999/silent",))
    with pytest.raises(UsageError, match="'SN9999' is not a unit of this run"):
        run_units(order, (), 1, RunOptions())


def test_a_recovery_makes_no_log(tmp_path: Path) -> None:
    from station.cli._recover import recover_unit

    order = RunOrder(simulate=True, database=tmp_path / "station.db")
    with pytest.raises(UsageError, match="There is no log"):
        recover_unit(order, "SN0001", None, "restore", as_json=False)
    assert list(tmp_path.iterdir()) == []
