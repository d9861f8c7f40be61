"""Samples tables: what is written is read back bit for bit, and every mistake is one sentence with its place."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyarrow import parquet

from station.adapters.samples import by_units, pieces, read_samples, write_parts, write_samples
from station.domain.core.types import SampleTable
from station.errors import SamplesError
from tests.fakes import tumble

HEADER = "unit,run,visit,position,time_s,x,y,z\n"
ROWS = "SN1,0,0,z-up,0.00,0.1,0.2,1.0\nSN1,0,0,z-up,0.01,0.1,0.2,1.1\nSN1,0,1,x-up,0.50,1.0,0.2,0.1\n"


def some(rng: np.random.Generator, units: int = 2) -> SampleTable:
    recipe = tumble.recipe("three-point")
    table = tumble.table(recipe, tumble.readings(tumble.units(rng, units), tumble.truths(recipe)), 1e-3, 7, rng)
    n = len(table)
    values = {"temperature_degC": 20 + rng.standard_normal(n), "counter": np.arange(n, dtype=float) % 16}
    return replace(table, values=values, gold=rng.standard_normal((n, 3)))


def written(folder: Path, text: str, name: str = "samples.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def same(one: SampleTable, other: SampleTable) -> None:
    for name in ("run", "visit", "time_s", "reading", "gold"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    assert one.unit.text().tolist() == other.unit.text().tolist()
    assert one.position.text().tolist() == other.position.text().tolist()
    assert set(one.values) == set(other.values)
    for name, column in one.values.items():
        assert np.array_equal(column, other.values[name]), name
    assert {k: v.text().tolist() for k, v in one.labels.items()} == {
        k: v.text().tolist() for k, v in other.labels.items()
    }


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_what_is_written_is_read_back(tmp_path: Path, rng: np.random.Generator, ending: str) -> None:
    table = some(rng)
    write_samples(table, tmp_path / f"t.{ending}")
    same(read_samples(tmp_path / f"t.{ending}"), table)


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False, width=64), min_size=3, max_size=3))
@settings(max_examples=30, deadline=None)
def test_every_reading_survives_as_text(tmp_path_factory: pytest.TempPathFactory, reading: list[float]) -> None:
    table = some(np.random.default_rng(1), 1)
    rows = table.reading.copy()
    rows[0] = reading
    path = tmp_path_factory.mktemp("csv") / "t.csv"
    write_samples(replace(table, reading=rows), path)
    assert np.array_equal(read_samples(path).reading, rows)


def test_a_parquet_file_carries_its_schema(tmp_path: Path, rng: np.random.Generator) -> None:
    from pyarrow import parquet

    write_samples(some(rng), tmp_path / "t.parquet")
    assert parquet.read_schema(tmp_path / "t.parquet").metadata[b"schema"] == b"station.samples/1"


def test_small_parts_are_gathered_into_few_pieces(tmp_path: Path, rng: np.random.Generator) -> None:
    from pyarrow import parquet

    table = some(rng, 30)
    write_parts((table[table.unit.code == u] for u in range(30)), tmp_path / "t.parquet")
    assert parquet.ParquetFile(tmp_path / "t.parquet").num_row_groups == 1
    same(read_samples(tmp_path / "t.parquet"), table)


def test_columns_in_any_order_and_further_ones_of_your_own(tmp_path: Path) -> None:
    text = "remark,z,y,x,time_s,position,visit,run,unit\nhello,1,2,3,0.5,z-up,0,0,007\n"
    found = read_samples(written(tmp_path, text))
    assert found.reading.tolist() == [[3, 2, 1]]
    assert found.unit.names == ("007",)


def test_portions_are_whole_units(tmp_path: Path, rng: np.random.Generator) -> None:
    table = some(rng, 12)
    write_samples(table, tmp_path / "t.parquet")
    found = list(by_units(tmp_path / "t.parquet", rows=1))
    assert sum(map(len, found)) == len(table)
    observed: set[str] = set()
    for portion in found:
        names = set(portion.unit.text())
        assert not names & observed
        observed |= names


def test_units_whose_rows_are_mixed_come_in_one_portion(tmp_path: Path, rng: np.random.Generator) -> None:
    table = some(rng, 3)
    mixed = table[np.argsort(table.visit, kind="stable")]
    write_samples(mixed, tmp_path / "t.csv")
    (found,) = by_units(tmp_path / "t.csv", rows=1)
    same(found, mixed)


def test_pieces_of_a_large_file_are_small(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    from station.adapters.samples import reading

    monkeypatch.setattr(reading, "BLOCK", 4096)
    table = some(rng, 30)
    write_samples(table, tmp_path / "t.csv")
    found = list(pieces(tmp_path / "t.csv"))
    assert len(found) > 5
    same(read_samples(tmp_path / "t.csv"), table)


BAD = {
    "no rows": ("", "holds no samples"),
    "no column": (None, "has no column"),
    "letters": ("SN1,0,2,z-up,0.6,abc,0.2,1.0\n", "line 5, column x: 'abc' is not a number"),
    "infinite": ("SN1,0,2,z-up,0.6,inf,0.2,1.0\n", "line 5, column x: inf is not a finite number"),
    "nan": ("SN1,0,2,z-up,0.6,0.1,nan,1.0\n", "line 5, column y: the cell is empty"),
    "empty": ("SN1,0,2,z-up,0.6,0.1,0.2,\n", "line 5, column z: the cell is empty"),
    "half run": ("SN1,0.5,2,z-up,0.6,0.1,0.2,1\n", "line 5, column run: '0.5' is not a whole number"),
    "negative visit": ("SN1,0,-2,z-up,0.6,0.1,0.2,1\n", "line 5, column visit: -2 is not a whole number"),
    "no unit": (",0,2,z-up,0.6,0.1,0.2,1\n", "line 5, column unit: the cell is empty"),
    "short row": ("SN1,0,2,z-up\n", "line 5: 4 cells, but the header has 8"),
    "backwards": (
        "".join(f"SN1,0,2,z-up,{9 - i},0.1,0.2,1\n" for i in range(9)),
        "line 6, column time_s: 8 follows 9",
    ),
}


@pytest.mark.parametrize("what", list(BAD))
def test_a_mistake_is_one_sentence_with_its_place(tmp_path: Path, what: str) -> None:
    more, shown = BAD[what]
    text = (
        HEADER.replace(",z\n", "\n") + "SN1,0,0,z-up,0,1,1\n"
        if more is None
        else HEADER + (ROWS + more if more else "")
    )
    path = written(tmp_path, text)
    with pytest.raises(SamplesError) as caught:
        read_samples(path)
    assert shown in caught.value.sentence
    assert str(path) in caught.value.sentence
    assert "\n" not in caught.value.sentence


@pytest.mark.parametrize(
    ("header", "shown"),
    [
        ("unit,run,visit,position,time_s,x,y,z,temprature_degC", "did you mean 'temperature_degC'?"),
        ("unit,run,visit,position,time_s,x,y,z,x", "has the column 'x' twice"),
        ("unit,run,visit,position,time_s,x,y,z,gold_x", "gold_x but not all of gold_x, gold_y, gold_z"),
        ("Unit,run,visit,position,time_s,x,y,z", "did you mean 'unit'?"),
    ],
)
def test_a_header_that_cannot_be_meant(tmp_path: Path, header: str, shown: str) -> None:
    with pytest.raises(SamplesError) as caught:
        read_samples(written(tmp_path, header + "\n" + "0," * header.count(",") + "0\n"))
    assert shown in caught.value.sentence


@pytest.mark.parametrize(("name", "shown"), [("t.txt", "is a .csv or a .parquet file"), ("none.csv", "no such file")])
def test_a_file_that_is_none(tmp_path: Path, name: str, shown: str) -> None:
    if name == "t.txt":
        written(tmp_path, HEADER, name)
    with pytest.raises(SamplesError, match=shown):
        read_samples(tmp_path / name)


def test_bytes_that_are_no_table(tmp_path: Path) -> None:
    for name in ("t.csv", "t.parquet"):
        (tmp_path / name).write_bytes(bytes(range(256)) * 20)
        with pytest.raises(SamplesError):
            read_samples(tmp_path / name)


def test_a_parquet_of_another_schema_or_with_text_for_numbers(tmp_path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    columns = (
        {n: ["a"] for n in ("unit", "position")}
        | {n: [0] for n in ("run", "visit")}
        | {n: ["q"] for n in ("time_s", "x", "y", "z")}
    )
    parquet.write_table(pa.table(columns), tmp_path / "t.parquet")
    with pytest.raises(SamplesError, match="column time_s: type string cannot be read as numbers"):
        read_samples(tmp_path / "t.parquet")
    parquet.write_table(pa.table(columns).replace_schema_metadata({"schema": "other/2"}), tmp_path / "t.parquet")
    with pytest.raises(SamplesError, match="has the schema 'other/2'"):
        read_samples(tmp_path / "t.parquet")


@pytest.mark.parametrize("dictionary", [True, False])
@pytest.mark.parametrize("read", [read_samples, lambda path: list(by_units(path))])
def test_text_in_parquet_that_is_no_utf_8(tmp_path: Path, dictionary: bool, read: Callable[[Path], object]) -> None:
    path = tmp_path / "t.parquet"
    plain = {n: pa.array(["SN1", "SN1"]) for n in ("unit", "position")} | {n: [0, 0] for n in ("run", "visit")}
    table = pa.table(plain | {n: [0.0, 1.0] for n in ("time_s", "x", "y", "z")})
    parquet.write_table(table, path, compression="none", use_dictionary=dictionary, store_schema=False)
    assert read(path)
    path.write_bytes(path.read_bytes().replace(b"SN1", b"S\xad1"))
    with pytest.raises(SamplesError, match="is not a readable Parquet file"):
        read(path)


def test_a_table_far_too_wide_is_refused_at_once(tmp_path: Path) -> None:
    names = ",".join(f"c{i}" for i in range(30_000))
    for text in (f"{names}\n", "x" * 50_000_000):
        with pytest.raises(SamplesError, match="it is no samples table"):
            read_samples(written(tmp_path, text))
    path = tmp_path / "wide.parquet"
    parquet.write_table(pa.table({f"c{i}": [0.0] for i in range(2000)}), path)
    with pytest.raises(SamplesError, match="it is no samples table"):
        read_samples(path)


def test_a_small_file_that_unfolds_into_memory_is_refused(tmp_path: Path) -> None:
    """Twenty million equal rows are some kilobytes of Parquet."""
    path = tmp_path / "bomb.parquet"
    rows = 20_000_000
    parquet.write_table(pa.table({"x": pa.array(np.zeros(rows, np.int8))}), path, compression="zstd")
    assert path.stat().st_size < 100_000
    with pytest.raises(SamplesError, match="it is no measured table"):
        read_samples(path)
