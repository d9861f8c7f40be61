"""One real tumble, an Xsens turned by hand, in every shape that people and loggers write: the same rests, unit and rate
from each, with no option."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy import io

from station.domain.core.types import Floats
from tests.integration.test_import import check, understood
from tests.integration.test_import_content import refused

#: Every fourth reading, 25 Hz, tells as much of rest and keeps a case below a tenth of a second.
EACH, RATE_HZ = 4, 25.0
#: Rests and orientations; at 25 Hz the last two of the 39, half a degree apart, are one.
VISITS, POSES = 38, 14
#: Counts a g, and the count at 0, by its makers' calibration.
COUNTS, ZERO = 4072.0, 32768
EPOCH_NS = 1_700_000_000_000_000_000


@pytest.fixture(scope="module")
def real(reference_data: Path) -> Floats:
    """Time in s and x, y, z in g (n, 4)."""
    raw = np.loadtxt(reference_data / "xsens_mti_tumble" / "xsens_acc.mat")[::EACH]
    return np.column_stack((raw[:, 0], (raw[:, 1:] - ZERO) / COUNTS))


def lines(
    data: Floats, header: Sequence[str] = (), sep: str = ",", fmt: str = "%.6f", point: str = ".", each: int = 0
) -> str:
    """Rows as text below the header's lines; each: the last header line comes again every so many rows."""
    rows = [sep.join(fmt % v for v in row).replace(".", point) for row in data]
    if each:
        rows = [r for i, row in enumerate(rows) for r in ([header[-1], row] if i and i % each == 0 else [row])]
    return "\n".join([*header, *rows]) + "\n"


def stamped(data: Floats, scale: float) -> Floats:
    return np.column_stack((data[:, 0] * scale, data[:, 1:]))


def with_gaps(data: Floats) -> str:
    rows = lines(data, ["time,ax,ay,az"]).splitlines()
    return "\n".join(r if i % 97 else r.split(",")[0] + ",nan,nan,nan" for i, r in enumerate(rows, 1)) + "\n"


def epoch_ns(data: Floats) -> str:
    rows = (f"{EPOCH_NS + round(t * 1e9)},{x:.5f},{y:.5f},{z:.5f}" for t, x, y, z in data)
    return "#timestamp [ns],a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n" + "\n".join(rows) + "\n"


def in_m_s2(data: Floats) -> Floats:
    return np.column_stack((data[:, 0], data[:, 1:] * 9.80665))


def beside_quaternions(data: Floats) -> str:
    turn = np.linspace(0, 3, len(data))
    q = np.c_[np.cos(turn), np.sin(turn), np.zeros((len(data), 2))]
    return lines(np.c_[data[:, 0], q, data[:, 1:]], ["time,qw,qx,qy,qz,Acc_X,Acc_Y,Acc_Z"])


TEXTS: dict[str, tuple[str, Callable[[Floats], str]]] = {
    "comma.csv": ("utf-8", lambda d: lines(d, ["time,ax,ay,az"])),
    "decimal-comma.csv": ("utf-8", lambda d: lines(d, ["Zeit;ax;ay;az"], sep=";", point=",")),
    "bom.csv": ("utf-8-sig", lambda d: lines(d, ["time (s),ax (g),ay (g),az (g)"])),
    "utf-16.tsv": ("utf-16", lambda d: lines(d, ["time\tax\tay\taz"], sep="\t")),
    "brackets.csv": ("utf-8", lambda d: lines(in_m_s2(d), ["t [s],acc_x [m/s^2],acc_y [m/s^2],acc_z [m/s^2]"])),
    "two-headers.csv": ("utf-8", lambda d: lines(in_m_s2(d), ["time,ax,ay,az", "s,m/s^2,m/s^2,m/s^2"])),
    "header-again.csv": ("utf-8", lambda d: lines(d, ["time,ax,ay,az"], each=1000)),
    "gaps.csv": ("utf-8", with_gaps),
    "epoch.csv": ("utf-8", lambda d: epoch_ns(in_m_s2(d))),
    "boot-ms.txt": ("utf-8", lambda d: lines(stamped(d, 1e3), sep=" ")),
    "micros.log": ("utf-8", lambda d: lines(stamped(d, 1e6), ["micros,ax,ay,az"])),
    "quaternions.csv": ("utf-8", beside_quaternions),
    "phyphox.csv": (
        "utf-8",
        lambda d: lines(
            in_m_s2(d),
            [",".join(f'"{w}"' for w in ("Time (s)", *(f"Acceleration {a} (m/s^2)" for a in "xyz")))],
            fmt="%.9E",
        ),
    ),
    "named.txt": ("utf-8", lambda d: "".join("t={:.3f} ax={:.5f} ay={:.5f} az={:.5f}\n".format(*row) for row in d)),
    "rows.jsonl": (
        "utf-8",
        lambda d: "".join(
            json.dumps(dict(zip(("t", "ax", "ay", "az"), row, strict=True))) + "\n" for row in d.tolist()
        ),
    ),
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_real_tumble_as_text(real: Floats, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    encoding, write = TEXTS[name]
    (tmp_path / name).write_text(write(real), encoding)
    is_the_tumble(understood(capsys, str(tmp_path / name)))


def labelled_matrix(path: Path, data: Floats) -> None:
    """As planners of ground stations export a flight log."""
    label = np.array(["LineNo", "TimeUS", "AccX", "AccY", "AccZ"], object)
    rows = np.c_[np.arange(len(data)), np.round(data[:, 0] * 1e6), data[:, 1:] * 9.80665]
    io.savemat(path, {"IMU": rows, "IMU_label": label, "Seen": np.array(["IMU", "MSG"], object)})


def without_checksums(path: Path, data: Floats) -> None:
    """As a writer that computes no checksum right."""
    io.savemat(path, {"time": data[:, 0], "ax": data[:, 1], "ay": data[:, 2], "az": data[:, 3]}, do_compression=True)
    content, place = bytearray(path.read_bytes()), 128
    while place < len(content):
        place += 8 + int.from_bytes(content[place + 4 : place + 8], "little")
        content[place - 4 : place] = bytes(4)
    path.write_bytes(bytes(content))


def arrow(path: Path, data: Floats) -> None:
    columns = zip(("time_s", "acc_x", "acc_y", "acc_z"), data.T, strict=True)
    pq.write_table(pa.table({n: v.astype(np.float32) if n[0] == "a" else v for n, v in columns}), path)


BINARIES: dict[str, Callable[[Path, Floats], object]] = {
    "labels.mat": labelled_matrix,
    "checksums.mat": without_checksums,
    "numbers.mat": lambda path, d: io.savemat(path, {"data": d.T}),
    "columns.mat": lambda path, d: io.savemat(
        path, {"s": {"data": d, "colheaders": np.array(["time", "ax", "ay", "az"], object)}}
    ),
    "array.npy": np.save,
    "table.parquet": arrow,
}


@pytest.mark.parametrize("name", BINARIES)
def test_a_real_tumble_as_binary(real: Floats, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    BINARIES[name](tmp_path / name, real)
    one = understood(capsys, str(tmp_path / name))
    is_the_tumble(one)
    wrong = any(r["id"] == "checksums-wrong" for r in one["remarks"])
    assert wrong == (name == "checksums.mat")


def is_the_tumble(one: dict[str, Any]) -> None:
    check(one, visits=VISITS, visits_by="rest", poses=POSES, rate_hz=RATE_HZ)
    assert one["raw_unit"] in ("g", "m/s²")
    assert 0.8 < one["magnitude"]["least"] < 1.0 < one["magnitude"]["greatest"] < 1.3


def test_a_damaged_matlab_file_is_refused(real: Floats, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One wrong checksum of four is damage."""
    without_checksums(tmp_path / "a.mat", real)
    io.savemat(tmp_path / "b.mat", {"ax": real[:, 1]}, do_compression=True)
    whole, right = (tmp_path / "a.mat").read_bytes(), (tmp_path / "b.mat").read_bytes()[128:]
    (tmp_path / "a.mat").write_bytes(whole + right)
    assert "damaged" in refused(capsys, str(tmp_path / "a.mat"))


def test_blocks_of_a_real_hand_as_a_spreadsheet_writes_them(
    reference_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """160 poses in blocks of 100 readings, no stamps: with decimal commas, and as one text column of three."""
    table = pd.read_csv(reference_data / "ck_handheld" / "acc_log.csv")
    table.to_csv(tmp_path / "a.csv", index=False, sep=";", decimal=",", encoding="utf-8-sig")
    check(understood(capsys, str(tmp_path / "a.csv")), visits=160, visits_by="shown-blocks", raw_unit="g")
