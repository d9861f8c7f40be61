"""Figures: well-formed, complete, and safe with any text."""

import itertools
import math
import xml.etree.ElementTree as ET

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from station.reporting.drawing import limit_bar, scale, tables
from station.reporting.drawing.box import Box, draw_boxes
from station.reporting.drawing.drawing import Drawing
from station.reporting.drawing.figure import Figure, Series, panels, plot, svg
from station.reporting.drawing.levels import Level
from station.reporting.number_text import format_to_uncertainty

NS = "{http://www.w3.org/2000/svg}"


def test_a_figure_holds_every_point_and_its_words() -> None:
    f = Figure(
        "Residual", "position", "mg", (Series([0, 1, 2], [1.0, -2.0, 3.0], "measured"),), x_names=("a", "b", "c")
    )
    root = ET.fromstring(svg(f))
    assert len(root.findall(f"{NS}circle")) == 3 + 1  # the legend shows the mark, too
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
    ET.fromstring(tables.bar_chart(words, [(words, 1.0)]))
    ET.fromstring(tables.heat_map(words, [[1.0, math.nan]], [words], [words, "b"]))


def test_a_point_that_leads_somewhere_says_where() -> None:
    links = [("/audit/unit?serial=A&B", "A&B"), ("/audit/unit?serial=C", "C")]
    drawn = ET.fromstring(svg(Figure("t", "x", "y", (Series([0.0, 1.0], [0.0, 1.0], "units", "dots", links=links),))))
    named = [(a.get("href"), a.get("aria-label")) for a in drawn.iter() if a.tag.endswith("a") and a.get("href")]
    assert named == links


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_ticks_are_round_and_inside(low: float, width: float) -> None:
    found = scale.ticks(low, low + width)
    assert 2 <= len(found) <= 12
    near = width * 1e-6 + 4 * math.ulp(abs(low) + width)
    assert all(low - near <= t <= low + width + near for t in found)


def test_a_figure_without_data_still_draws() -> None:
    ET.fromstring(svg(Figure("empty", "x", "y", ())))
    ET.fromstring(tables.bar_chart("empty", []))


def test_a_cloud_is_one_stroke_however_many_points() -> None:
    many = Series(range(5000), range(5000), "residual", kind="cloud")
    root = ET.fromstring(svg(Figure("t", "x", "y", (many, Series([0.0], [1.0], kind="dashes")))))
    cloud, dash = root.findall(f"{NS}path")
    assert (cloud.get("d") or "").count("M") == 5000
    assert (dash.get("d") or "").endswith("h25.2")


def test_panels_stand_below_each_other_and_each_has_its_title() -> None:
    one, two = (Figure(name, "x", "y", (Series([0], [1]),), height=100) for name in ("first", "second"))
    root = ET.fromstring(panels("both", [one, two]))
    assert [g.get("transform") for g in root.findall(f"{NS}g")] == ["translate(0 28)", "translate(0 128)"]
    assert {"both", "first", "second"} <= {t.text for t in root.iter(f"{NS}text")}
    assert root.get("height") == "232"


@pytest.mark.parametrize(("value", "closer"), [(0.0369, False), (0.078, True), (0.0824, True)])
def test_a_closer_look_is_drawn_only_near_a_limit(value: float, closer: bool) -> None:
    bar = limit_bar.LimitBar(value, 0.0006, -0.08, 0.08, 0.0, ("low", "target", "high", "ok"))
    drawn = str(limit_bar.draw(bar, "x"))
    assert ('height="216"' in drawn) is closer
    assert 'stroke="#677683"' in drawn if closer else 'stroke="#677683"' not in drawn


@given(st.floats(0.001, 0.0125), st.sampled_from([1, -1]))
@example(0.00997, 1)
def test_figures_of_the_closer_look_are_those_of_the_certificate(expanded: float, side: int) -> None:
    value = side * (0.08 - expanded / 2)
    drawn = str(limit_bar.draw(limit_bar.LimitBar(value, expanded, -0.08, 0.08, 0.0, ("a", "b", "c", "d")), "x"))
    assert f">{format_to_uncertainty(value, expanded)} ± {format_to_uncertainty(expanded, expanded)}<" in drawn


@pytest.mark.parametrize("value", [0.7, 0.9899, 0.9999, 1.001, 1.3])
def test_labels_of_narrow_limits_do_not_meet(value: float) -> None:
    words = ("Untergrenze", "Sollwert", "Obergrenze", "erlaubt")
    root = ET.fromstring(str(limit_bar.draw(limit_bar.LimitBar(value, 0.0031, 0.995, 1.005, 1.0, words), "gain x")))
    placed: dict[str, list[tuple[float, float]]] = {}
    for text in (t for t in root.iter(f"{NS}text") if (t.text or "").startswith(words)):
        wide = scale.text_width(text.text or "", 13)
        left = float(text.attrib["x"]) - {"middle": wide / 2, "end": wide}.get(text.attrib.get("text-anchor", ""), 0.0)
        placed.setdefault(text.attrib["y"], []).append((left, left + wide))
    for row in placed.values():
        row.sort()
        assert all(right < left for (_, right), (left, _) in itertools.pairwise(row))
    assert sum(map(len, placed.values())) == (3 if 0.98 < value < 1.02 else 2)


def beyond_paper(drawing: Drawing) -> list[str]:
    """Texts that stick out of the paper of a phone, as wide as they are in common letters."""
    root = ET.fromstring(drawing.narrow())
    wide = float(root.attrib["width"])
    found = []
    for text in root.iter(f"{NS}text"):
        if "transform" in text.attrib:
            continue
        long = 0.9 * scale.text_width(text.text or "", int(text.attrib["font-size"]))
        anchor = text.attrib["text-anchor"]
        left = float(text.attrib["x"]) - {"start": 0.0, "middle": long / 2, "end": long}[anchor]
        if left < -1 or left + long > wide + 1:
            found.append(text.text or "")
    return found


def test_on_a_phone_every_word_stands_on_the_paper() -> None:
    long = ("Stückzahl außerhalb der Grenzen", "berechnen und schreiben", "Identifizieren")
    lines = tuple(Series([0, 1], [i, i + 1], f"{name} {i}") for i, name in enumerate(long))
    words = ("Untergrenze", "Sollwert", "Obergrenze", "erlaubt")
    levels = [Level(-0.08, "USG -0.08", "limit"), Level(0.01, "Mittelwert 0.0123", "centre")]
    for drawing in (
        plot(Figure("Ein Titel, der für ein Telefon zu lang geraten ist", "x", "y", lines)),
        tables.bar_drawing("Taktzeit eines guten Stücks", [(name, 12.3) for name in long], "s"),
        tables.pareto("Gründe", [tables.Count(name, i + 1) for i, name in enumerate(long)], "Summe"),
        limit_bar.draw(limit_bar.LimitBar(0.0824, 0.0006, -0.08, 0.08, 0.0, words), "Nullpunkt"),
        draw_boxes("Nach Nest", [Box(nest, 7, (0, 1, 2, 3, 4)) for nest in "ABCD"], levels),
    ):
        assert beyond_paper(drawing) == []
        assert 'width="350"' in drawing.narrow()
        assert 'width="350"' not in str(drawing)
