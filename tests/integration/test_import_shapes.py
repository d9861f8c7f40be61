"""Files in the shapes that other people's loggers write: preambles, lines of units, odd clocks, names and values."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from station.domain.core.types import Floats
from tests.integration.test_import import G, check, tumble, understood

Shape = Callable[[Floats, Floats], str]


def joined(rows: Any, by: str) -> str:
    return "".join(by.join(f"{v:.6f}" if isinstance(v, float) else str(v) for v in row) + "\n" for row in rows)


def rows(y: Floats, turn: Floats, stamp: Callable[[int], Any]) -> list[list[Any]]:
    return [[stamp(i), *turn[i].tolist(), *(y[i] * G).tolist()] for i in range(len(y))]


def euroc(y: Floats, turn: Floats) -> str:
    head = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    head += "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n"
    return head + joined(rows(y, turn, lambda i: 1403636579758555392 + i * 10_000_000), ",")


def ticks(y: Floats, turn: Floats) -> str:
    """A counter of 100 µs that wraps at 2³², and a preamble of comments that states the rate."""
    head = (
        "// General information:\n// Update Rate: 100.0Hz\nSampleTimeFine\tGyr_X\tGyr_Y\tGyr_Z\tAcc_X\tAcc_Y\tAcc_Z\n"
    )
    return head + joined(rows(y, turn, lambda i: (4_294_900_000 + 100 * i) % 2**32), "\t")


def units_row(y: Floats, turn: Floats) -> str:
    names = ["Unix_CAL", *(f"Gyro_{a}_CAL" for a in "XYZ"), *(f"Accel_LN_{a}_CAL" for a in "XYZ")]
    units = ["ms", *["deg/s"] * 3, *["m/(s^2)"] * 3]
    head = '"sep=\t"\n' + joined([["Shimmer_Timestamp_" + names[0], *names[1:]], units], "\t")
    return head + joined(rows(y, turn, lambda i: 1.6e12 + 10.0 * i), "\t")


def trailing(y: Floats, turn: Floats) -> str:
    head = "sep=,\nDeviceTag:,Dot1\n\nPacketCounter,SampleTimeFine,Gyr_X,Gyr_Y,Gyr_Z,Acc_X,Acc_Y,Acc_Z,\n"
    return head + joined([[i, *row, ""] for i, row in enumerate(rows(y, turn, lambda i: 10_000 * i))], ",")


def spoken(y: Floats, turn: Floats) -> str:
    head = "Initializing I2C devices...\nMPU6050 connection successful\n"
    counts = np.c_[np.round(16384 * y), np.round(131 * turn)].astype(int).tolist()
    return head + "".join("a/g:\t" + "\t".join(map(str, row)) + "\n" for row in counts)


def keyed(y: Floats, turn: Floats) -> str:
    return "".join(f"t:{i / 100:.2f}, ax:{a:.4f}, ay:{b:.4f}, az:{c:.4f}\n" for i, (a, b, c) in enumerate(y * G))


def wrapping(y: Floats, turn: Floats) -> str:
    return "ms,ax,ay,az\n" + joined([[10 * i % 65536, *(row * G).tolist()] for i, row in enumerate(y)], ",")


def clock_text(y: Floats, turn: Floats) -> str:
    lines = [f"10:{21 + i // 6000:02d}:{i % 6000 / 100:06.3f}".replace(".", ",") for i in range(len(y))]
    cells = [";".join(f"{v:.5f}" for v in row).replace(".", ",") for row in (y * G).tolist()]
    return "time;ax;ay;az\n" + "".join(f"{a};{b}\n" for a, b in zip(lines, cells, strict=True))


@pytest.mark.parametrize(
    ("shape", "raw_unit", "time_unit"),
    [
        (euroc, "m/s²", "ns"),
        (ticks, "m/s²", "none"),
        (units_row, "m/s²", "ms"),
        (trailing, "m/s²", "us"),
        (spoken, "LSB", "none"),
        (keyed, "m/s²", "s"),
        (wrapping, "m/s²", "ms"),
        (clock_text, "m/s²", "s"),
    ],
)
def test_shapes_of_other_loggers(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    shape: Shape, raw_unit: str, time_unit: str,
) -> None:  # fmt: skip
    y = tumble(rng)
    turn = 0.02 + 0.1 * rng.standard_normal(y.shape) + 40 * np.gradient(y, axis=0)
    path = tmp_path / "log.txt"
    path.write_text(shape(y, turn), encoding="utf-8")
    one = understood(capsys, str(path))
    check(one, rate_hz=100.0, raw_unit=raw_unit, time_unit=time_unit, visits=8, poses=8, gaps=0)
    assert one["magnitude"]["median"] == pytest.approx(1.0, abs=0.01)
