"""A thermometer that stands still is told of, one that lives or is too coarse to tell is not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from station.adapters.dbc import read_layouts
from station.config.products import load_product
from station.config.search_path import shipped_folder
from station.domain.can import encode
from station.domain.can.sensor_layout import SensorLayout, resolve
from station.domain.capture.thermometer import MIN_VISITS, frozen_warning
from station.domain.capture.visit import CapturedVisit, Visit, decode_visit

NODE = 17


@pytest.fixture(scope="module")
def layout() -> SensorLayout:
    frames = load_product("accelerometer", None).frames
    return resolve(frames, read_layouts(Path(shipped_folder(), "dbc", frames.dbc)))


def visits(layout: SensorLayout, *temperatures_degC: float | None, node: int = NODE) -> list[Visit]:
    """One visit for each temperature; None: no such frame came there."""
    read = [np.array([] if t is None else [t]) for t in temperatures_degC]
    frames = [encode.temperature_frames(layout, NODE, np.arange(len(t)), t) for t in read]
    captured = [CapturedVisit(0, i, "z-up", "home", 0, 0, 1, f) for i, f in enumerate(frames)]
    return [decode_visit(visit, layout, node) for visit in captured]


def test_six_stops_at_one_temperature_are_told_of(layout: SensorLayout) -> None:
    warning = frozen_warning(visits(layout, *[24.31] * MIN_VISITS), layout)
    assert warning is not None
    assert (warning.id, warning.parameters["visits"]) == ("thermometer-frozen", 6)
    assert warning.parameters["value"] == pytest.approx(24.31)


@pytest.mark.parametrize(
    "read",
    [
        [24.31] * (MIN_VISITS - 1),
        [24.31] * (MIN_VISITS - 1) + [24.32],
        [24.31] * (MIN_VISITS - 1) + [None] * 3,
        [None] * 9,
    ],
)
def test_too_few_stops_or_one_step_tell_nothing(layout: SensorLayout, read: list[float | None]) -> None:
    assert frozen_warning(visits(layout, *read), layout) is None


def test_a_coarse_thermometer_may_stand_still(layout: SensorLayout) -> None:
    assert layout.temperature is not None
    signals = tuple(replace(s, scale=0.5) for s in layout.temperature.signals)
    coarse = replace(layout, temperature=replace(layout.temperature, signals=signals))
    assert frozen_warning(visits(coarse, *[24.5] * 20), coarse) is None


def test_another_units_thermometer_is_not_this_ones(layout: SensorLayout) -> None:
    assert frozen_warning(visits(layout, *[24.31] * MIN_VISITS, node=NODE + 1), layout) is None
