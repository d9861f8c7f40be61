"""Kept stops become a samples table: the dwell's rows only, in order, on the run's clock."""

from pathlib import Path

import numpy as np
import pytest

from station.adapters.dbc import read_layouts
from station.config.products import load_product
from station.config.search_path import shipped_folder
from station.domain.can import encode
from station.domain.can.sensor_layout import SensorLayout, resolve
from station.domain.capture.assemble import sample_table
from station.domain.capture.visit import CapturedVisit, Visit, decode_visit, dwell_frames
from station.domain.core.types import Frames

NODE, LSB, START = 17, 1e-4, 1_767_225_600_000_000_000


@pytest.fixture(scope="module")
def layout() -> SensorLayout:
    product = load_product("accelerometer", None)
    return resolve(product.frames, read_layouts(Path(shipped_folder(), "dbc", product.frames.dbc)))


def frames_at(layout: SensorLayout, begin_s: float, xyz: tuple[float, float, float], n: int = 50) -> Frames:
    time_ns = START + np.round((begin_s + np.arange(n) / 100) * 1e9).astype(np.int64)
    return encode.sample_frames(layout, NODE, time_ns, np.tile(xyz, (n, 1)))


def visit(
    layout: SensorLayout, number: int, run: int, begin_s: float, xyz: tuple[float, float, float]
) -> CapturedVisit:
    begin = START + round(begin_s * 1e9)
    return CapturedVisit(
        run, number, f"p{number}", "home", begin, begin + 200_000_000, begin + 400_000_000,
        frames_at(layout, begin_s, xyz),
    )  # fmt: skip


def decoded(layout: SensorLayout, visits: list[CapturedVisit]) -> list[Visit]:
    return [decode_visit(one, layout, NODE) for one in visits]


def test_only_the_dwell_is_in_the_table_on_the_clock_of_its_run(layout: SensorLayout) -> None:
    visits = [
        visit(layout, 0, 0, 5.0, (0, 0, 1)),
        visit(layout, 1, 0, 9.0, (0, 1, 0)),
        visit(layout, 0, 1, 30.0, (1, 0, 0)),
    ]
    table = sample_table("SN0042", decoded(layout, visits), layout.counter_values, {"nest": "A", "lot": ""})
    assert len(table) == 60
    assert list(table.unit.text()[:1]) == ["SN0042"]
    assert table.run.tolist() == [0] * 40 + [1] * 20
    assert table.visit.tolist() == [0] * 20 + [1] * 20 + [0] * 20
    assert sorted(set(table.position.text())) == ["p0", "p1"]
    np.testing.assert_allclose(table.time_s[[0, 19, 20, 40]], [0.2, 0.39, 4.2, 0.2], atol=1e-9)
    np.testing.assert_allclose(table.values["started_s"][[0, 40]], [0.0, 25.0], atol=1e-9)
    np.testing.assert_allclose(table.reading[[0, 20, 40]], np.eye(3)[::-1], atol=LSB / 2)
    assert set(table.labels) == {"seating", "nest"}


def test_a_bad_crc_is_left_out_and_a_repeat_only_kept_for_exports(layout: SensorLayout) -> None:
    stored = visit(layout, 0, 0, 0.0, (0, 0, 1))
    data = stored.frames.data.copy()
    data[22, 3] ^= 1  # broken on the way
    data[25] = data[24]  # the same frame once more
    broken = CapturedVisit(0, 0, "p0", "home", stored.arrived_ns, stored.from_ns, stored.to_ns,
                       Frames(stored.frames.time_ns, stored.frames.can_id, stored.frames.length, data))  # fmt: skip
    assert len(dwell_frames(broken)) == 20
    assert len(sample_table("SN1", decoded(layout, [broken]), layout.counter_values)) == 18
    assert len(sample_table("SN1", decoded(layout, [broken]), layout.counter_values, everything=True)) == 19


def test_no_visits_make_an_empty_table(layout: SensorLayout) -> None:
    assert len(sample_table("SN1", decoded(layout, []), layout.counter_values)) == 0


def test_the_counter_counts_on_modulo_what_the_recipe_says(layout: SensorLayout) -> None:
    frames = frames_at(layout, 0.0, (0, 0, 1), 400)
    stored = [
        CapturedVisit(
            0, i, f"p{i}", "home", START + i * 2 * 10**9, START + i * 2 * 10**9, START + (2 * i + 1) * 10**9, frames
        )
        for i in range(2)
    ]
    table = sample_table("SN1", decoded(layout, stored), layout.counter_values, counter_bits=8)
    # Two dwells of 100 frames, 100 frames of moving between them: the count goes on as if nobody had looked away.
    wanted = np.concatenate([np.arange(100), np.arange(200, 300)]) % 256
    assert table.values["counter"].tolist() == wanted.tolist()


def test_moves_longer_than_the_stops_do_not_bend_the_count(layout: SensorLayout) -> None:
    """The counter of the end-to-end profile goes round ten times while the fixture moves."""
    frames = frames_at(layout, 0.0, (0, 0, 1), 3000)
    starts = [START + i * 2_510_000_000 for i in range(10)]
    stored = [CapturedVisit(0, i, f"p{i}", "home", t, t, t + 10**9, frames) for i, t in enumerate(starts)]
    table = sample_table("SN1", decoded(layout, stored), layout.counter_values, counter_bits=16)
    assert table.values["counter"].tolist() == np.concatenate([i * 251 + np.arange(100) for i in range(10)]).tolist()
