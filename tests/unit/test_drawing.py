"""Figures: well-formed, complete, and safe with any text."""

import math
import xml.etree.ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.drawing import scale, tables
from station.drawing.figure import Figure, Series, svg

NS = "{http://www.w3.org/2000/svg}"


def test_a_figure_holds_every_point_and_its_words() -> None:
    f = Figure(
        "Residual", "position", "mg", (Series([0, 1, 2], [1.0, -2.0, 3.0], "measured"),), x_names=("a", "b", "c")
    )
    root = ET.fromstring(svg(f))
    assert len(root.findall(f"{NS}circle")) == 3
    words = [t.text for t in root.iter(f"{NS}text")]
    assert {"Residual", "position", "mg", "measured", "a", "b", "c"} <= set(words)
    assert root.find(f"{NS}title") is not None


@pytest.mark.parametrize("kind", ["dots", "line", "steps", "bars"])
def test_every_kind_draws_with_a_spread(kind: str) -> None:
    s = Series([0, 1], [1, 2], kind=kind, low=[0.5, 1.5], high=[1.5, 2.5])  # type: ignore[arg-type]
    root = ET.fromstring(svg(Figure("t", "x", "y", (s,), levels=((2.2, "limit"),))))
    assert any("NaN" not in ET.tostring(e, "unicode") for e in root)


@given(st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=30))
def test_no_text_breaks_the_page(words: str) -> None:
    root = ET.fromstring(svg(Figure(words, words, words, (Series([0], [0], words),), x_names=(words,))))
    assert root.findtext(f"{NS}title") == words
    ET.fromstring(tables.bars(words, [(words, 1.0)]))
    ET.fromstring(tables.heat_map(words, [[1.0, math.nan]], [words], [words, "b"]))


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_ticks_are_round_and_inside(low: float, width: float) -> None:
    found = scale.ticks(low, low + width)
    assert 2 <= len(found) <= 12
    assert all(low - width * 1e-6 <= t <= low + width * (1 + 1e-6) for t in found)


def test_a_figure_without_data_still_draws() -> None:
    ET.fromstring(svg(Figure("empty", "x", "y", ())))
    ET.fromstring(tables.bars("empty", []))
