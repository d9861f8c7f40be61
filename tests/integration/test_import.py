"""Recordings written by others' tools, in every shape: what `station import` and `station segment` make of them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import io

from station.domain.core.types import Floats
from station.wiring.sample_files import read_samples
from tests.fakes.command import station

G = 9.80665
FACES = np.array([[0, 0, 1], [0, 1, 0], [1, 0, 0], [0, 0, -1], [0, -1, 0], [-1, 0, 0], [0.6, 0.8, 0], [0, 0.6, -0.8]])


def tumble(rng: np.random.Generator, rate_hz: float = 100.0, still_s: float = 4.0, move_s: float = 1.0) -> Floats:
    """Readings (n, 3) in g of eight poses with moves between."""
    parts = []
    for here, there in zip(FACES, np.roll(FACES, -1, axis=0), strict=True):
        parts.append(np.tile(here, (round(still_s * rate_hz), 1)))
        share = np.linspace(0, 1, max(round(move_s * rate_hz), 2))[:, None]
        parts.append(here * (1 - share) + there * share + 0.2 * rng.standard_normal((len(share), 3)))
    reading = np.concatenate(parts[:-1])
    return np.asarray(reading + 0.002 * rng.standard_normal(reading.shape))


def understood(capsys: pytest.CaptureFixture[str], *args: str) -> dict[str, Any]:
    """What `station import … --json` says of the one recording."""
    code = station("import", *args, "--json")
    shown = capsys.readouterr()
    assert code == 0, shown.err
    (one,) = json.loads(shown.out)["recordings"]
    return dict(one)


def check(one: dict[str, Any], **wanted: Any) -> None:
    for key, value in wanted.items():
        assert one[key] == (pytest.approx(value, rel=0.02) if isinstance(value, float) else value), key


@pytest.mark.parametrize(
    ("header", "step", "unit"),
    [
        ("time", 0.01, "s"),
        ("t [ms]", 10.0, "ms"),
        ("timestamp", 10_000.0, "us"),
        ("time_ns", 1e7, "ns"),
        ("t", 10, "ms"),
    ],
)
def test_time_in_any_unit_is_recognised(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str], header: str, step: float, unit: str
) -> None:
    y = tumble(rng) * G
    table = pd.DataFrame({header: np.arange(len(y)) * step, "accX": y[:, 0], "accY": y[:, 1], "accZ": y[:, 2]})
    table.to_csv(tmp_path / "a.csv", index=False)
    one = understood(capsys, str(tmp_path / "a.csv"))
    check(one, time_unit=unit, rate_hz=100.0, raw_unit="m/s²", visits=8, poses=8, gaps=0)
    assert "unit" in one["inferred"]


@pytest.mark.parametrize(
    ("delimiter", "decimal"), [(",", "."), (";", ","), ("\t", "."), ("\t", ","), ("|", "."), (" ", ".")]
)
def test_any_delimiter_and_decimal_mark(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str], delimiter: str, decimal: str
) -> None:
    y = tumble(rng)
    table = pd.DataFrame({"t": np.arange(len(y)) / 50, "ax": y[:, 0], "ay": y[:, 1], "az": y[:, 2], "temp": 21.5})
    path = tmp_path / "a.txt"
    path.write_text("# logger 7\n" + table.to_csv(sep=delimiter, decimal=decimal, index=False), encoding="utf-8")
    one = understood(capsys, str(path))
    check(one, rate_hz=50.0, raw_unit="g", visits=8, temperature_degC=[21.5, 21.5], axes=["ax", "ay", "az"])


def test_accelerometer_and_gyroscope_are_told_apart_without_a_header(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    y = tumble(rng)
    turn = 0.5 + 0.2 * rng.standard_normal(y.shape) + 60 * np.gradient(y, axis=0)
    np.savetxt(tmp_path / "a.dat", np.c_[np.arange(len(y)) / 100, turn, y * G], fmt="%.5f")
    one = understood(capsys, str(tmp_path / "a.dat"))
    check(one, axes=["column 4", "column 5", "column 6"], raw_unit="m/s²", rate_hz=100.0)
    assert {"axes", "unit", "rate"} <= set(one["inferred"])


def test_order_of_columns_follows_names_and_not_places(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As phones' loggers write: stamps twice, z first."""
    y = tumble(rng) * G
    stamps = 1_672_531_200_000_000_000 + (np.arange(len(y)) * 10_000_000)
    table = pd.DataFrame(
        {"time": stamps, "seconds_elapsed": np.arange(len(y)) / 100, "z": y[:, 2], "y": y[:, 1], "x": y[:, 0]}
    )
    table.to_csv(tmp_path / "Accelerometer.csv", index=False)
    out = tmp_path / "s.parquet"
    one = understood(capsys, str(tmp_path / "Accelerometer.csv"), "--out", str(out))
    check(one, axes=["x", "y", "z"], rate_hz=100.0, visits=8)
    table_ = read_samples(out)
    assert table_.reading[table_.visit == 2].mean(axis=0) == pytest.approx([1, 0, 0], abs=0.01)


def test_counts_about_a_middle_and_milli_g_are_recognised(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    y = tumble(rng)
    stamps = np.arange(len(y)) / 100
    pd.DataFrame(np.c_[stamps, np.round(32768 + 16384 * y)]).to_csv(tmp_path / "c.csv", index=False, header=False)
    check(understood(capsys, str(tmp_path / "c.csv")), raw_unit="LSB", zero=32768.0, scale=1 / 16384)
    table = pd.DataFrame({"t": stamps, **{f"acc_{a} (mg)": 1000 * y[:, i] for i, a in enumerate("xyz")}})
    table.to_csv(tmp_path / "m.csv", index=False)
    one = understood(capsys, str(tmp_path / "m.csv"))
    check(one, raw_unit="mg", scale=1e-3)
    assert "unit" not in one["inferred"]


def test_matlab_files_of_vectors_matrices_and_structs(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    y = tumble(rng)
    t = np.arange(len(y)) / 200
    io.savemat(tmp_path / "v.mat", {"t": t, "ax": y[:, 0], "ay": y[:, 1], "az": y[:, 2], "note": "first"})
    io.savemat(tmp_path / "m.mat", {"acc": (y * G).T, "fs": 200.0})
    io.savemat(tmp_path / "s.mat", {"imu": {"time": t, "acc": y, "gyr": 0.1 * y}}, do_compression=True)
    check(understood(capsys, str(tmp_path / "v.mat")), rate_hz=200.0, raw_unit="g", visits=8)
    check(understood(capsys, str(tmp_path / "m.mat")), rate_hz=200.0, raw_unit="m/s²", time_unit="none", visits=8)
    check(understood(capsys, str(tmp_path / "s.mat")), rate_hz=200.0, axes=["imu.acc_0", "imu.acc_1", "imu.acc_2"])


def test_mf4_signals(rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from asammdf import MDF, Signal

    y = tumble(rng) * G
    t = np.arange(len(y)) / 100
    mdf = MDF()
    mdf.append([Signal(y[:, i], t, unit="m/s^2", name=f"Acc_{a}") for i, a in enumerate("XYZ")])
    mdf.append([Signal(np.full(50, 24.0), np.arange(50) / 2, unit="degC", name="Other")])
    mdf.save(tmp_path / "a.mf4")
    mdf.close()
    check(understood(capsys, str(tmp_path / "a.mf4")), rate_hz=100.0, raw_unit="m/s²", visits=8)


def test_parquet_with_time_stamps(rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    y = tumble(rng)
    when = pd.date_range("2026-03-01", periods=len(y), freq="10ms", tz="UTC")
    pd.DataFrame({"when time": when, "X": y[:, 0], "Y": y[:, 1], "Z": y[:, 2]}).to_parquet(tmp_path / "a.parquet")
    check(understood(capsys, str(tmp_path / "a.parquet")), rate_hz=100.0, visits=8)


def test_blocks_and_labels_are_visits(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    y = np.repeat(FACES, 50, axis=0) + 0.002 * rng.standard_normal((400, 3))
    table = pd.DataFrame(y, columns=["x", "y", "z"])
    table.to_csv(tmp_path / "b.csv", index=False)
    check(understood(capsys, str(tmp_path / "b.csv")), visits=8, visits_by="shown-blocks")
    check(understood(capsys, str(tmp_path / "b.csv"), "--blocks", "25"), visits=16, visits_by="blocks", poses=8)
    table.assign(face=np.repeat(list("abcdefgh"), 50)).to_csv(tmp_path / "l.csv", index=False)
    out = tmp_path / "s.csv"
    check(understood(capsys, str(tmp_path / "l.csv"), "--out", str(out)), visits=8, visits_by="labels")
    assert read_samples(out).position.names == tuple("abcdefgh")


def test_files_are_units_or_runs(rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = []
    for name in ("A1", "A2"):
        y = tumble(rng)
        files.append(str(tmp_path / f"{name}.csv"))
        pd.DataFrame(np.c_[np.arange(len(y)) / 100, y], columns=["t", "x", "y", "z"]).to_csv(files[-1], index=False)
    out = str(tmp_path / "s.parquet")
    assert station("import", *files, "--out", out) == 0
    assert read_samples(Path(out)).unit.names == ("A1", "A2")
    assert station("import", *files, "--runs", "--serial", "SN7", "--out", out) == 0
    table = read_samples(Path(out))
    assert (table.unit.names, np.unique(table.run).tolist()) == (("SN7",), [0, 1])


def test_segment_takes_what_import_writes_raw(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    y = tumble(rng)
    table = pd.DataFrame(np.c_[np.arange(len(y)) / 100, y * G], columns=["t", "x", "y", "z"])
    table.assign(temperature=22.0).to_csv(tmp_path / "a.csv", index=False)
    raw, direct, out = (str(tmp_path / name) for name in ("raw.parquet", "direct.parquet", "s.parquet"))
    assert station("import", str(tmp_path / "a.csv"), "--serial", "SN9", "--raw", "--out", raw) == 0
    capsys.readouterr()
    whole = understood(capsys, str(tmp_path / "a.csv"), "--raw")
    assert whole["magnitude"]["median"] == pytest.approx(1.0, abs=0.01)
    assert max(whole["noise"]) < 0.01
    assert station("segment", raw, "--out", out) == 0
    assert station("segment", str(tmp_path / "a.csv"), "--serial", "SN9", "--out", direct) == 0
    one, other = read_samples(Path(out)), read_samples(Path(direct))
    assert one.unit.names == other.unit.names == ("SN9",)
    assert one.reading == pytest.approx(other.reading, abs=1e-12)
    assert one.values["temperature_degC"] == pytest.approx(22.0)


@pytest.mark.parametrize("move_s", [0.02, 0.18, 0.2])
def test_six_faces_with_quick_moves_are_never_merged(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str], move_s: float
) -> None:
    y = tumble(rng, still_s=5.0, move_s=move_s)
    pd.DataFrame(np.c_[np.arange(len(y)) / 100, y], columns=["t", "x", "y", "z"]).to_csv(
        tmp_path / "a.csv", index=False
    )
    out = tmp_path / "s.parquet"
    assert station("segment", str(tmp_path / "a.csv"), "--out", str(out)) == 0
    table = read_samples(out)
    assert table.visit.max() == 7
    for visit, face in enumerate(FACES):
        assert table.reading[table.visit == visit].mean(axis=0) == pytest.approx(face, abs=0.005)


WRONG = {
    "empty.csv": (b"", "is empty"),
    "words.csv": (b"hello world, this\nis no table\nof readings at all\n", "no table of numbers"),
    "two.csv": (b"t,x\n" + b"".join(b"%d,1.0\n" % i for i in range(100)), "no three columns"),
    "ragged.csv": (b"t,x,y,z\n" + b"0,1,2,3\n1,2,3,4\n2,3,4\n" * 60, "cells where the others have 4"),
    "zeros.bin": (bytes(5000), "neither text nor"),
    "broken.parquet": (b"PAR1" + bytes(200), "cannot be parsed"),
    "broken.mat": (b"MATLAB 5.0 MAT-file" + bytes(300), "cannot be parsed"),
    "wide.csv": (
        b",".join(b"c%d" % i for i in range(30_000)) + b"\n" + b",".join([b"1.5"] * 30_000),
        "columns; at most",
    ),
    "long.csv": (b"a,b,c\n1,2," + b"9" * 300_000, "longer than"),
    "runs.csv": (
        b"unit,run,time_s,x,y,z\n" + b"".join(b"A,1e300,%.2f,0,0,1\n" % (i / 100) for i in range(300)),
        "column run: 1e+300 is not a whole number",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_recording_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    content, says = WRONG[name]
    (tmp_path / name).write_bytes(content)
    assert station("import", str(tmp_path / name)) == 2
    shown = capsys.readouterr().err
    assert shown.count("\n") == 1
    assert says in shown
    assert name in shown


@pytest.mark.parametrize("kind", ["driving", "shaking", "backwards", "one pose"])
def test_what_is_no_tumble_is_one_sentence(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    n = 6000
    t, y = np.arange(n) / 100, np.tile([0.0, 0.0, 1.0], (n, 1)) + 0.002 * rng.standard_normal((n, 3))
    if kind == "driving":
        y[500:] += np.cumsum(0.01 * rng.standard_normal((n - 500, 3)), axis=0)
    elif kind == "shaking":
        y += np.sin(2 * np.pi * 7 * t)[:, None] * rng.uniform(0.1, 1.0, (n, 1))
    elif kind == "backwards":
        t = rng.permutation(t)
    pd.DataFrame(np.c_[t, y], columns=["t", "x", "y", "z"]).to_csv(tmp_path / "a.csv", index=False)
    assert station("segment", str(tmp_path / "a.csv"), "--out", str(tmp_path / "s.csv")) == 2
    shown = capsys.readouterr().err
    assert shown.count("\n") == 1
    assert not (tmp_path / "s.csv").exists()


def test_real_recordings_are_understood(reference_data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    xsens = understood(capsys, str(reference_data / "xsens_mti_tumble" / "xsens_acc.mat"))
    check(xsens, visits=39, rate_hz=100.0, time_unit="s", zero=32768.0)
    hand = understood(capsys, str(reference_data / "ck_handheld" / "acc_log.csv"))
    check(hand, visits=160, visits_by="shown-blocks", raw_unit="g", time_unit="none")
    labelled = understood(capsys, str(reference_data / "imucal_ferraris" / "annotated_session.csv"))
    check(labelled, visits=9, visits_by="labels", raw_unit="LSB", scale=1 / 2048)
    session = understood(capsys, str(reference_data / "imucal_ferraris" / "example_ferraris_session.csv"))
    check(session, raw_unit="m/s²", axes=["acc_x", "acc_y", "acc_z"], poses=6)
    can, dbc = (
        reference_data / "css_canmod" / "2F6913DB_00000004_00000001.MF4",
        reference_data / "css_canmod" / "canmod-gps.dbc",
    )
    # That it is no tumble, and refused: test_import_to_diagnosis.py.
    driving = understood(capsys, str(can), "--dbc", str(dbc), "--raw")
    check(driving, raw_unit="m/s²", axes=["AccelerationX", "AccelerationY", "AccelerationZ"])
