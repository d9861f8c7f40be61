"""Tables of a fleet that do not belong together, or to this version: refused, and the way out that is told works."""

import json
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pytest
from pyarrow import parquet

from station.cli.app import main
from tests.fakes import shared_fleet

Out = pytest.CaptureFixture[str]
UNITS, SEED = 200, 5
#: Of the units; those after it were made with another recipe.
CHANGED = 100


@pytest.fixture
def tables(tmp_path: Path) -> Path:
    shared_fleet.write(tmp_path / "fleet", UNITS, lambda *_: shared_fleet.NOTHING, SEED)
    return tmp_path / "fleet"


def rewritten(folder: Path, change: Callable[[pa.Table], pa.Table]) -> None:
    """Every file of the fleet as `change` makes it."""
    for path in folder.rglob("*.parquet"):
        parquet.write_table(change(parquet.ParquetFile(path).read()), path)


def with_two_recipes(table: pa.Table) -> pa.Table:
    """The later units: the same name, another dwell."""
    texts = table.column("recipe").to_pylist()
    for i, serial in enumerate(table.column("serial").to_pylist()):
        if int(serial[2:]) >= CHANGED:
            recipe = json.loads(texts[i])
            recipe["version"] += 1
            texts[i] = json.dumps(recipe)
    return table.set_column(table.column_names.index("recipe"), "recipe", [texts])


def station(capsys: Out, *words: str | Path, code: int) -> str:
    with pytest.raises(SystemExit) as ended:
        main([*map(str, words), "--processes", "1"])
    shown = capsys.readouterr()
    assert ended.value.code == code, shown.err
    return shown.out if code == 0 else shown.err


def test_units_of_several_recipes_are_not_compared_and_since_chooses_those_of_one(tables: Path, capsys: Out) -> None:
    rewritten(tables, with_two_recipes)
    words = ("diagnose", "--shared", "--recipe", "six-point", "--db", tables)
    refused = station(capsys, *words, code=2)
    assert "made with 2 different recipes named 'six-point'" in refused
    assert "choose those of one recipe with --since" in refused
    since = shared_fleet.FIRST + CHANGED * shared_fleet.STEP
    assert "No group of the 100 units" in station(capsys, *words, "--since", since.isoformat(), code=0)


def test_tables_of_another_schema_are_refused_whatever_asks(tables: Path, capsys: Out) -> None:
    rewritten(tables, lambda table: table.replace_schema_metadata({"schema": "station.fleet/9"}))
    for command in (("diagnose", "--shared"), ("calibrate",), ("backtest",)):
        refused = station(capsys, *command, "--recipe", "six-point", "--db", tables, code=2)
        assert "has schema 'station.fleet/9'; this version reads" in refused
        assert "station export --parquet" in refused


@pytest.mark.parametrize("place", range(4, 3000, 599))
def test_damage_inside_a_table_is_a_sentence_whatever_asks(tables: Path, capsys: Out, place: int) -> None:
    for damaged in (tables / "reduced").rglob("*.parquet"):
        whole = bytearray(damaged.read_bytes())
        whole[place : place + 300] = b"\xad" * 300
        damaged.write_bytes(whole)
    for command in (("diagnose", "--shared"), ("calibrate",), ("backtest",)):
        refused = station(capsys, *command, "--recipe", "six-point", "--db", tables, code=2)
        assert "is no whole Parquet file" in refused


@pytest.mark.parametrize("words", [("calibrate",), ("diagnose", "--shared")])
def test_a_document_that_cannot_be_written_is_refused_before_the_fleet_is_computed(
    words: tuple[str, ...], tables: Path, tmp_path: Path, capsys: Out
) -> None:
    kept, nowhere = tmp_path / "kept", tmp_path / "nowhere" / "found.json"
    said = station(
        capsys, *words, "--recipe", "six-point", "--db", tables, "--results", kept, "--json", nowhere, code=2
    )
    assert "--json" in said
    assert not kept.exists()


def test_what_is_no_scheduler_is_refused_before_a_folder_of_results_is_made(
    tables: Path, capsys: Out, tmp_path: Path
) -> None:
    words = ("backtest", "--recipe", "six-point", "--db", tables, "--results", tmp_path / "kept", "--scheduler", "-7d")
    assert "'-7d' is no address of a scheduler" in station(capsys, *words, code=2)
    assert not (tmp_path / "kept").exists()
