"""Text as loggers and terminals write it: stamps in every spelling, words and brackets about numbers, cells left empty,
JSON, and files of arrays."""

import json
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from station.domain.core.types import Floats
from tests.fakes.command import station
from tests.integration.test_import import check, tumble, understood

Capture = pytest.CaptureFixture[str]
Stamp = Callable[[datetime, float], str]
BEGIN = datetime(2024, 3, 5, 23, 59, 40, tzinfo=UTC)


def milli(form: str) -> Stamp:
    return lambda now, t: now.strftime(form)[:-3]


def lines(y: Floats, row: Callable[[datetime, float, list[float]], str]) -> str:
    made = (row(BEGIN + timedelta(milliseconds=10 * i), i / 100, r) for i, r in enumerate(y.tolist()))
    return "".join(line + "\n" for line in made)


@pytest.mark.parametrize(
    "stamp",
    [
        milli("%Y%m%d-%H%M%S.%f"),
        milli("%Y%m%d%H%M%S%f"),
        milli("%Y_%m_%d_%H_%M_%S_%f"),
        lambda now, t: now.strftime("%a %b %d %H:%M:%S.%f")[:-3] + " 2024",
        lambda now, t: now.strftime("%Y-%m-%d %H:%M:%S.%f")[:-3] + "-0400 [Brazil/West]",
        lambda now, t: now.strftime("%Y-%m-%d %H:%M:%S"),
        lambda now, t: f"{t // 60:.0f}:{t % 60:05.2f}",
        lambda now, t: f"{t:.2f}s",
        lambda now, t: f"{1000 * t:.0f} ms",
        lambda now, t: f"{now.timestamp():.0f}",
    ],
)
def test_stamps_in_any_spelling(rng: np.random.Generator, tmp_path: Path, capsys: Capture, stamp: Stamp) -> None:
    path = tmp_path / "log.csv"
    text = lines(tumble(rng), lambda now, t, r: f"{stamp(now, t)},{r[0]:.4f},{r[1]:.4f},{r[2]:.4f}")
    path.write_text("time,x,y,z\n" + text, encoding="utf-8")
    check(understood(capsys, str(path)), rate_hz=100.0, visits=8, poses=8, gaps=0, raw_unit="g")


@pytest.mark.parametrize(("header", "size"), [("Time (min)", 1 / 60), ("time [h]", 1 / 3600), ("datenum", 1 / 86_400)])
def test_stamps_in_long_units(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, header: str, size: float
) -> None:
    path = tmp_path / "log.csv"
    text = lines(tumble(rng), lambda now, t, r: f"{5 + t * size:.10f},{r[0]:.4f},{r[1]:.4f},{r[2]:.4f}")
    path.write_text(f"{header},x,y,z\n" + text, encoding="utf-8")
    check(understood(capsys, str(path)), rate_hz=100.0, visits=8)


def test_stamps_that_nobody_can_read_are_said_with_the_remedy(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    path = tmp_path / "log.csv"
    text = lines(tumble(rng), lambda now, t, r: f"T+0h{t:06.2f}q{r[0]:.0f},{r[0]:.4f},{r[1]:.4f},{r[2]:.4f}")
    path.write_text("time,x,y,z\n" + text, encoding="utf-8")
    one = understood(capsys, str(path))
    check(one, visits=8, time_unit="none")
    assert [r["id"] for r in one["remarks"]] == ["stamps-unread"]
    assert station("import", str(path)) == 0
    assert "state --rate" in capsys.readouterr().out
    assert understood(capsys, str(path), "--rate", "50")["remarks"] == []


def clock(now: datetime) -> str:
    return now.strftime("%H:%M:%S.%f")[:-3]


@pytest.mark.parametrize(
    ("row", "time_unit"),
    [
        (lambda now, t, r: f"{clock(now)} -> {r[0]:.4f},{r[1]:.4f},{r[2]:.4f}", "s"),
        (lambda now, t, r: f"{clock(now)} -> Raw:{r[0]:.4f},{r[1]:.4f},{r[2]:.4f},{0.1 + t % 0.7:.3f}", "s"),
        (lambda now, t, r: f"Raw:{r[0]:.4f},{r[1]:.4f},{r[2]:.4f}", "none"),
        (lambda now, t, r: f"$ACC,{t:.2f},{r[0]:.4f},{r[1]:.4f},{r[2]:.4f}*{round(100 * t) % 256:02X}", "s"),
        (lambda now, t, r: f"({r[0]:.4f}, {r[1]:.4f}, {r[2]:.4f})", "none"),
        (lambda now, t, r: f"[{t:.2f}] [{r[0]:.4f}, {r[1]:.4f}, {r[2]:.4f}]", "s"),
        (lambda now, t, r: f"{clock(now)} INFO imu: ax={r[0]:.4f} ay={r[1]:.4f} az={r[2]:.4f}", "s"),
        (lambda now, t, r: f"{t:.2f};{r[0]:.4f} g;{r[1]:.4f} g;{r[2]:.4f} g", "s"),
        (lambda now, t, r: '"{:.2f}","{:.4f}","{:.4f}","{:.4f}"'.format(t, *r).replace(".", ","), "s"),
    ],
)
def test_numbers_among_words_and_brackets(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture,
    row: Callable[[datetime, float, list[float]], str], time_unit: str,
) -> None:  # fmt: skip
    path = tmp_path / "terminal.txt"
    path.write_text("sensor found\n" + lines(tumble(rng), row), encoding="utf-8")
    one = understood(capsys, str(path))
    check(one, rate_hz=100.0, time_unit=time_unit, visits=8, poses=8, raw_unit="g")
    assert one["magnitude"]["median"] == pytest.approx(1, abs=0.01)


def test_cells_in_hex(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "hex.csv"
    words = np.round(tumble(rng) * 4096).astype(int) % 65_536
    rows = (",".join(f"0x{word:04X}" for word in row) for row in words.tolist())
    path.write_text("x,y,z\n" + "\n".join(rows), encoding="utf-8")
    check(understood(capsys, str(path)), raw_unit="LSB", scale=1 / 4096, visits=8, poses=8)


def test_a_last_column_that_is_mostly_empty(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    """A thermometer at another rate, or a label in some rows."""
    path = tmp_path / "two.csv"

    def row(now: datetime, t: float, r: list[float]) -> str:
        return f"{t:.2f},{r[0]:.4f},{r[1]:.4f},{r[2]:.4f}," + (f"{25 + t / 10:.1f}" if round(100 * t) % 10 == 0 else "")

    path.write_text("time,x,y,z,temp\n" + lines(tumble(rng), row), encoding="utf-8")
    one = understood(capsys, str(path))
    check(one, rate_hz=100.0, visits=8)
    assert one["temperature_degC"] == pytest.approx([25.0, 28.9], abs=0.2)


def test_rows_of_which_only_the_later_end_with_a_delimiter(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    """A spreadsheet with remarks beside its first rows."""
    path = tmp_path / "book.csv"

    def row(now: datetime, t: float, r: list[float]) -> str:
        return f"{t:.2f},{r[0]:.4f},{r[1]:.4f},{r[2]:.4f}," + (f"{t:.1f}" if t < 0.6 else "")

    path.write_text("time,x,y,z,\n" + lines(tumble(rng), row), encoding="utf-8")
    check(understood(capsys, str(path)), visits=8, raw_unit="g")


def as_json(y: Floats, shape: str) -> str:
    time, cells = (np.arange(len(y)) / 100).tolist(), y.round(5).tolist()
    pairs = list(zip(time, cells, strict=True))
    named = [{"time": t, "acc": dict(zip("xyz", r, strict=True)), "ok": True} for t, r in pairs]
    texts: dict[str, Callable[[], str]] = {
        "lines": lambda: "\n".join(map(json.dumps, named)),
        "records": lambda: json.dumps(named, indent=1),
        "within": lambda: json.dumps({"device": {"id": 7}, "samples": named}),
        "columns": lambda: json.dumps({"time": time, "acc": {a: y[:, i].tolist() for i, a in enumerate("xyz")}}),
        "lists": lambda: "\n".join(json.dumps({"t": t, "accel": r}) for t, r in pairs),
    }
    return texts[shape]()


@pytest.mark.parametrize("shape", ["lines", "records", "within", "columns", "lists"])
def test_json(rng: np.random.Generator, tmp_path: Path, capsys: Capture, shape: str) -> None:
    path = tmp_path / "log.json"
    path.write_text(as_json(tumble(rng), shape), encoding="utf-8")
    check(understood(capsys, str(path)), rate_hz=100.0, visits=8, poses=8, raw_unit="g")


def test_json_of_several_sensors(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "log.jsonl"
    records = [
        json.dumps({"t": i / 100, "sensor": kind, **dict(zip("xyz", row.tolist(), strict=True))})
        for i, y in enumerate(tumble(rng))
        for kind, row in (("gyro", 30 * rng.standard_normal(3)), ("acc", y))
    ]
    path.write_text("\n".join(records), encoding="utf-8")
    check(understood(capsys, str(path)), rate_hz=100.0, visits=8, poses=8, raw_unit="g")


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a": 1', "[1, 2, 3]", '{"a": {"b": []}}', "[[]]" * 30, "{}\n" * 40])
def test_json_of_nothing_is_one_sentence(tmp_path: Path, capsys: Capture, text: str) -> None:
    path = tmp_path / "log.json"
    path.write_text(text, encoding="utf-8")
    assert station("import", str(path)) == 2
    assert capsys.readouterr().err.count("\n") == 1


def arrays(path: Path, y: Floats, kind: str) -> Path:
    time = np.arange(len(y)) / 100
    path = path / f"log.{kind.split('-', maxsplit=1)[0]}"
    if kind == "npy":
        np.save(path, np.c_[time, y])
    elif kind == "npz":
        np.savez_compressed(path, time=time, acc=y, title=np.array("tumble"))
    elif kind == "h5":
        with h5py.File(path, "w") as file:
            file["imu/time"], file["imu/acc"] = time, y
    else:
        stamps = pa.array((time * 1e6).astype("i8"), pa.timestamp("us"))
        shapes: dict[str, Any] = {
            "list": {"acc": pa.array(y.tolist())},
            "struct": {"acc": pa.array([dict(zip("xyz", r, strict=True)) for r in y.tolist()])},
            "text": {a: [f"{v:.5f}" for v in y[:, i]] for i, a in enumerate("xyz")},
        }
        cells = shapes[kind.rpartition("-")[2]]
        parquet.write_table(pa.table({"when": stamps, **cells}), path)
    return path


@pytest.mark.parametrize("kind", ["npy", "npz", "h5", "parquet-list", "parquet-struct", "parquet-text"])
def test_files_of_arrays(rng: np.random.Generator, tmp_path: Path, capsys: Capture, kind: str) -> None:
    check(understood(capsys, str(arrays(tmp_path, tumble(rng), kind))), rate_hz=100.0, visits=8, poses=8, raw_unit="g")


def test_an_array_of_objects_runs_no_code_of_theirs(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "log.npy"
    np.save(path, np.array([{"x": 1}] * 20, object))
    assert station("import", str(path)) == 2
    assert "cannot be parsed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("head", "parts"),
    [
        ("header.stamp.secs,header.stamp.nsecs,ax,ay,az", 10**9),
        ("sec,nanosec,ax,ay,az", 10**9),
        ("tv_sec,tv_usec,ax,ay,az", 10**6),
        ("seconds,ms,ax,ay,az", 10**3),
        ("", 10**9),
    ],
)
def test_stamps_in_two_columns(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture, head: str, parts: int
) -> None:
    """As `ros2 topic echo --csv` writes them without a header, frame and covariance beside the readings."""
    text = [head] if head else []
    for i, r in enumerate(tumble(rng) * 9.80665):
        ticks = (1_700_000_000 * 100 + i) * (parts // 100)
        beside = "" if head else "imu," + "0.0," * 4
        text.append(f"{ticks // parts},{ticks % parts},{beside}{r[0]:.4f},{r[1]:.4f},{r[2]:.4f}")
    path = tmp_path / "imu.csv"
    path.write_text("\n".join(text) + "\n")
    one = understood(capsys, str(path))
    check(one, visits=8, poses=8, raw_unit="m/s²")
    assert one["rate_hz"] == pytest.approx(100.0, rel=1e-4)
    if not head:
        again = understood(capsys, str(path), "--columns", "0,7,8,9")
        assert again["axes"] == one["axes"] == ["column 7", "column 8", "column 9"]


def test_lines_of_two_sensors_that_take_turns(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    """Of a terminal that shows a state between each two readings the line that names axes is a row."""
    path = tmp_path / "terminal.txt"

    def row(now: datetime, t: float, r: list[float]) -> str:
        return f"State: sys 3, gyro 3, mag {t % 4:.0f}\nAccel X = {r[0]:.4f}, Y = {r[1]:.4f}, Z = {r[2]:.4f}, w = 9"

    path.write_text(lines(tumble(rng), row), encoding="utf-8")
    check(understood(capsys, str(path), "--rate", "100"), axes=["X", "Y", "Z"], visits=8, poses=8)


def test_three_numbers_in_brackets_are_the_axes_of_their_name(
    rng: np.random.Generator, tmp_path: Path, capsys: Capture
) -> None:
    path = tmp_path / "boot.log"

    def row(now: datetime, t: float, r: list[float]) -> str:
        a, b, c = (round(16384 * v) for v in r)
        return f"RAW 0x68: gyro=({t:.0f}, 12, -7) temp={4060 + round(t)} accel=({a}, {b}, {c})"

    path.write_text("boot: chip revision v0.4\n" * 9 + lines(tumble(rng), row), encoding="utf-8")
    one = understood(capsys, str(path), "--rate", "100")
    check(one, axes=["accel_x", "accel_y", "accel_z"], visits=8, poses=8, scale=1 / 16384)


def test_a_comment_that_says_so_names_the_columns(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "bench.txt"
    head = "# columns: index ; time_s ; az ; ay ; ax\n#\n# NOTE: nothing else is trustworthy.\n\n"
    path.write_text(head + lines(tumble(rng), lambda now, t, r: f"{100 * t:.0f} ; {t:.3f} ; {r[2]:.4f} ; {r[1]:.4f} ; "
                                 f"{r[0]:.4f}"), encoding="utf-8")  # fmt: skip
    check(understood(capsys, str(path)), axes=["ax", "ay", "az"], time_unit="s", rate_hz=100.0, visits=8)


def test_stamps_of_today_behind_the_readings(rng: np.random.Generator, tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "nameless.txt"
    path.write_text(lines(tumble(rng), lambda now, t, r: f"100|{r[0]:.4f}|{r[1]:.4f}|{r[2]:.4f}|"
                          f"{1589445931768 + 1000 * t:.0f}"), encoding="utf-8")  # fmt: skip
    check(understood(capsys, str(path)), axes=["column 1", "column 2", "column 3"], time_unit="ms", rate_hz=100.0)
