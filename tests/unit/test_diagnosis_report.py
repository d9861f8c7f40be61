"""The report: right words for every verdict, figures of whatever was recorded, small and safe."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from station.cli._diagnosis_page import html
from station.cli._hypotheses_text import lines, parameter_line
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.results.diagnosis_document import cause_names
from station.diagnosis.results.smallest_effect import detectable_length
from station.diagnosis.search.finding import CauseFinding
from station.domain.core.types import Floats, Labels, SampleTable
from station.reporting.diagnosis.cause_text import makes_testable
from station.reporting.diagnosis.data import CauseSignature, DwellCourse, FormulaCurve, ReportData
from station.reporting.diagnosis.hypothesis_section import draw_curve, formula_sentences
from station.reporting.diagnosis.page import ReportPage, ReportSection, build_page
from station.reporting.diagnosis.plot_axis import best_axis, plot_axis
from station.reporting.diagnosis.quantity_format import format_interval, format_significant, format_size, unit_words
from station.reporting.diagnosis.samples import tone_spectrum

PLACES = ("z-up", "x-up", "y-up", "z-down")


def a_cause(effect: str, of: tuple[str, ...] = ("common",), **more: Any) -> dict[str, Any]:
    rows = [
        {"name": "coefficient", "axis": a, "of": o, "value": 3e-4 * (i + 1), "std": 1e-5, "unit": "g/degC"}
        for o in of
        for i, a in enumerate("xyz")
    ]
    gain = {
        "held_out_by": "visit", "rms_before": 2.1e-4, "rms_after": 8e-5, "explained": 0.97, "log_score": 412.0,
        "std_error": 21.0, "accepted": True,
    }  # fmt: skip
    base = {"effect": effect, "probability": 0.998, "indistinguishable_from": [], "level": "unit", "parameters": rows}
    return {**base, "gain": gain, **more}


def a_document(verdict: str, causes: list[dict[str, Any]], units: int, **more: Any) -> dict[str, Any]:
    return {
        "schema": "station.diagnosis/1",
        "data": {"units": units, "runs": units, "visits": 8 * units, "samples": 800 * units},
        "verdict": verdict,
        "baseline": {"residual_rms": 2.1e-4, "floor_rms": 7e-5, "unit": "g"},
        "alarm": {"family_wise_level": 0.01, "statistic": 31.2, "threshold": 3.6},
        "causes": causes,
        "unknown": {"depends_on": []},
        "not_testable": ["warm-up", "cross-quadratic"],
        "considered": [{"effect": "cubic", "log_evidence": -1.2, "probability": 0.0}],
        "next_run": None,
        **more,
    }


def some_data(
    verdict: str, causes: list[dict[str, Any]] | None = None, units: int = 2, names: tuple[str, ...] = (), **more: Any
) -> ReportData:
    """Units that went twice round four positions; the causes add 1 mg at the last position."""
    causes = causes or []
    rng = np.random.default_rng(1)
    stops = 8 * units
    place = np.tile(np.arange(4), 2 * units)
    visit = np.tile(np.arange(8), units)
    sign = np.where(place == 3, 1e-3, 0.0)[:, None] * np.array([1.0, 0.5, 0.0])
    after = rng.normal(0, 7e-5, (stops, 3))
    serials = names or tuple(f"SN{i:04d}" for i in range(units))
    document = {k: more.pop(k) for k in ("unknown", "next_run", "line", "considered", "floor") if k in more}
    fields: dict[str, Any] = {
        "document": a_document(verdict, causes, units, **document),
        "recipe": "tilt",
        "axes": ("x", "y", "z"),
        "unit": Labels(serials, np.repeat(np.arange(units, dtype=np.int32), 8)),
        "position": Labels(PLACES, place.astype(np.int32)),
        "run": np.zeros(stops, np.int32),
        "visit": visit.astype(np.int32),
        "previous": np.where(visit > 0, np.arange(stops) - 1, -1),
        "values": {"time_s": visit * 2.5, "temperature_degC": 23 + 0.1 * visit},
        "measured": rng.normal(size=(stops, 3)),
        "before": after + (sign if causes else 0.0),
        "after": after,
        "signatures": tuple(CauseSignature(c["effect"], sign) for c in causes),
    }
    return ReportData(**{**fields, **more})


def section(page: ReportPage, name: str) -> ReportSection:
    return next(s for s in page.sections if s.name == name)


def drawn(page: ReportPage) -> dict[str, ET.Element]:
    """Every figure, parsed: it must be well-formed and hold no number that is none."""
    found = page.pictures()
    assert not [name for name, svg in found.items() if "nan" in svg.lower().replace("nano", "") or "inf" in svg]
    return {name: ET.fromstring(svg) for name, svg in found.items()}


def test_the_sentence_says_what_how_big_on_whom_and_what_it_gains() -> None:
    page = build_page(some_data("named", [a_cause("offset-temperature", ("unit:SN0000", "unit:SN0001"))]))
    assert page.sentence == (
        "The offset follows the temperature. Size: up to 900 µg/°C on 2 of 2 units, different on each. Correcting it "
        "lowers the error on held-out data from 210 to 80 µg rms."
    )
    assert "thermometer" in page.do
    assert (page.symbol, page.badge) == ("▲", "cause found")
    assert page.lead is not None


def test_the_first_picture_shows_the_signature_over_what_the_cause_needs() -> None:
    lead_picture = build_page(some_data("named", [a_cause("offset-temperature")])).lead
    assert lead_picture is not None
    words = [t.text for t in ET.fromstring(lead_picture.svg).iter("{http://www.w3.org/2000/svg}text")]
    assert {"temperature, °C", "what the cause predicts", "measured, mean of a group ± 95 %"} <= set(words)
    assert "residual, µg" in words


@pytest.mark.parametrize(("effect", "points"), [("quadratic", 80), ("cubic", 80), ("asymmetry", 5)])
def test_a_curve_known_at_few_tilts_is_drawn_as_the_polynomial_that_it_is(effect: str, points: int) -> None:
    """It was five straight pieces; that of |a| is straight."""
    tilt = np.tile([-1.0, -0.7, 0.0, 0.7, 1.0, 0.7, -0.7, 0.0], 2)
    course = 1e-3 * {"quadratic": tilt**2, "cubic": tilt**3 - 0.8 * tilt, "asymmetry": np.abs(tilt)}[effect]
    sign = CauseSignature(effect, np.stack([course, 0 * tilt, 0 * tilt], axis=1))
    felt = np.stack([tilt, 0 * tilt, 0 * tilt], axis=1)
    page = build_page(some_data("named", [a_cause(effect)], signatures=(sign,), felt=felt))
    assert page.lead is not None
    lines = ET.fromstring(page.lead.svg).iter("{http://www.w3.org/2000/svg}polyline")
    assert points in [len(line.attrib["points"].split()) for line in lines]


def test_a_signature_is_drawn_over_the_axis_that_orders_it() -> None:
    data = some_data("named", [a_cause("index-error", ("position:z-down",))])
    signature, rows = data.signatures[0].values, np.ones(16, bool)
    found = best_axis(data, signature, rows, ())
    assert found is not None
    assert found.name == "position"
    noise = np.random.default_rng(2).normal(size=(16, 3))
    stops = best_axis(data, noise, rows, ())
    assert stops is not None
    assert (stops.name, stops.single) == ("stops", True)


def test_none_says_how_small_an_effect_would_have_been_seen() -> None:
    page = build_page(some_data("none", smallest={"cubic": 6.6e-5, "nest-tilt": 1.4e-5}))
    assert page.sentence.startswith("No cause found: the simulation accounts for")
    (table,) = [t for t in section(page, "limits").tables if "4 of 5" in t.caption]
    assert [row[:2] for row in table.rows] == [("cubic", "66 ppm/g²"), ("nest-tilt", "14 µrad")]
    assert not table.folded
    assert page.symbol == "✔"
    assert "gain" not in {s.name for s in page.sections}
    drawn(page)


def test_unknown_says_on_what_it_depends_and_shows_it() -> None:
    page = build_page(some_data("unknown", unknown={"depends_on": ["temperature", "order"]}))
    assert "depends on temperature and order of the visits" in page.sentence
    assert page.lead is not None
    assert "temperature, °C" in page.lead.svg
    assert "no cause of the library explains it" in section(page, "not-told-apart").text[0]


def test_incomplete_names_the_cause_and_what_is_left() -> None:
    page = build_page(some_data("incomplete", [a_cause("warm-up")], unknown={"depends_on": ["time"]}))
    assert page.sentence.endswith("What is left depends on time within the run.")
    assert page.badge == "cause found, but not all of it"


def test_what_cannot_be_told_apart_is_never_named_as_if_certain() -> None:
    run: dict[str, Any] = {
        "recipe_change": "one run 10 degC warmer",
        "separates": ["warm-up", "clamp-creep"],
        "minutes": 3.1,
    }
    run["certainty"] = 0.999
    cause = a_cause("warm-up", indistinguishable_from=["clamp-creep"])
    page = build_page(some_data("named", [cause], next_run=run))
    assert page.sentence.startswith("These data cannot tell warm-up from clamp-creep. Most likely: the device")
    assert page.do.startswith("Measure again with one run 10 degC warmer (3.1 min)")
    assert page.do.endswith("to separate warm-up, clamp-creep. Chance that a single cause is named then: 99 %.")
    assert "d·√κ < 3.3" in section(page, "not-told-apart").text[0]
    assert section(page, "next-run").text == (page.do,)
    lost = {"recipe_change": "a level on the rig", "separates": [], "minutes": 0.0, "certainty": 0.5}
    alone = build_page(some_data("named", [cause], next_run=lost))
    assert section(alone, "next-run").text[0].endswith("would not help. What would: a level on the rig.")
    helpless = build_page(some_data("named", [cause], next_run={**lost, "recipe_change": ""}))
    assert section(helpless, "next-run").text == (
        "No change of this recipe that the station knows of would separate them.",
    )
    left = {**run, "certainty": 0.004, "leaves": ["asymmetry", "quadratic"]}
    (words,) = section(build_page(some_data("named", [cause], next_run=left)), "next-run").text
    assert "named then: 0 %. asymmetry, quadratic may stay tied. What would tell them apart: tilts between" in words
    by_sets = {**run, "certainty": 0.61, "certainty_interval": [0.512, 0.701], "simulated_diagnoses": 96}
    (words,) = section(build_page(some_data("named", [cause], next_run=by_sets)), "next-run").text
    assert (
        "named then: 61 %. So many of 96 simulated diagnoses of it named the right one alone (95 %: 51 to 71 %)"
        in words
    )
    assert words.endswith("No further run that the station knows of makes that likelier.")
    assert "If it is warm-up: " in alone.do
    assert ". If it is clamp-creep: " in alone.do


def test_of_several_causes_the_largest_leads_and_each_has_its_section() -> None:
    small = a_cause("cubic")
    small["gain"] = {**small["gain"], "rms_before": 9e-5}
    page = build_page(some_data("named", [small, a_cause("nest-tilt", ("nest:N1",))]))
    assert page.sentence.startswith("The nest holds every part at the same wrong angle")
    assert "on nest N1" in page.sentence
    assert page.sentence.endswith("Another cause was found: cubic.")
    assert {"cause-1", "cause-2"} <= {s.name for s in page.sections}


def test_a_cause_that_is_found_in_two_forms_is_said_once() -> None:
    page = build_page(some_data("incomplete", [a_cause("lever-arm"), a_cause("lever-arm"), a_cause("cubic")]))
    assert page.sentence.count("Another cause was found: cubic.") == 1
    assert "lever-arm" not in page.sentence
    floor = NoiseFloor(1e-4, 0.0, 0.0)
    found = [
        CauseFinding(name, None, floor, {}, {}, others, 0.0, 0.0)
        for name, others in (("lever-arm", ()), ("cubic", ("asymmetry",)), ("lever-arm", ("settling",)))
    ]
    assert cause_names(found) == [
        "lever-arm, twice (or settling: these data cannot tell)",
        "cubic (or asymmetry: these data cannot tell)",
    ]


@pytest.mark.parametrize(
    ("of", "printed"),
    [
        (("visit:SN/7/2/5",), "unit SN/7, run 2, visit 5"),
        (("run:SN1/0", "run:SN2/0"), "2 runs, the first: unit SN1, run 0"),
        (("position:a", "position:b", "position:c", "position:d"), "4 positions (a, b, c …)"),
        (("operator:Ann",), "operator Ann"),
        (("common",), "every unit"),
    ],
)
def test_whom_it_concerns(of: tuple[str, ...], printed: str) -> None:
    assert f" on {printed}." in build_page(some_data("named", [a_cause("step", of)])).sentence


def test_a_gross_fault_shows_what_was_read_against_what_should_be() -> None:
    mapping = {"name": "mapping", "axis": None, "of": "unit:SN0000", "value": "-y,x,z", "std": None, "unit": "text"}
    cause = a_cause("axis-permutation", parameters=[mapping])
    expected = np.eye(3)[np.arange(16) % 3]
    page = build_page(some_data("named", [cause], signatures=(), read=expected[:, [1, 0, 2]], expected=expected))
    assert "What stands on x, y, z: -y,x,z, on unit SN0000." in page.sentence
    assert page.lead is not None
    assert "ideal unit" in page.lead.svg


def test_a_cause_that_was_found_twice_is_drawn_with_all_it_does() -> None:
    parts = [CauseSignature("step", np.eye(2)[:, [i, 1 - i]] * (i + 1), None) for i in range(2)]
    drawn = some_data("named", [a_cause("step")], signatures=tuple(parts)).signature("step")
    assert drawn is not None
    assert drawn.values.tolist() == [[1.0, 2.0], [2.0, 1.0]]


def test_a_cause_within_the_dwell_is_shown_within_the_dwell() -> None:
    course = DwellCourse(np.array([0.03, 0.5]), np.array([1e-3, 0.0]), np.array([9e-4, 0.0]))
    page = build_page(some_data("named", [a_cause("settling")], dwell=course))
    assert page.lead is not None
    assert "settling within the dwell" in page.lead.svg
    assert "time since the dwell began, s" in page.lead.svg


def test_noise_stands_as_high_in_the_spectrum_whether_the_motors_run_or_not() -> None:
    """What is measured at a part of the drive is brought to the whole of it, and its noise with it."""
    rng, dwells, n = np.random.default_rng(2), 80, 50
    drive = np.repeat(np.where(np.arange(dwells) % 2, 0.4, 0.0), n)
    visit = np.repeat(np.arange(dwells, dtype=np.int32), n)
    one, at = Labels(("SN0000",), np.zeros(dwells * n, np.int32)), np.arange(dwells * n) / 50
    found = tone_spectrum(
        SampleTable(one, 0 * visit, visit, one, at, rng.standard_normal((dwells * n, 3)), values={"motor": drive})
    )
    assert found is not None
    assert found.off is not None
    # Mean powers of 2 × 40 exponentials each at 25 frequencies, of which neighbours share a window.
    assert np.mean(found.on**2) / np.mean(found.off**2) == pytest.approx(1.0, abs=4 * np.sqrt(2 * 2 / (40 * 25)))


def test_a_gain_that_is_none_of_means_has_no_bars_of_rms() -> None:
    gain = {**a_cause("motor-tone")["gain"], "rms_before": None, "rms_after": None, "explained": None}
    page = build_page(some_data("named", [a_cause("motor-tone", gain=gain)], signatures=()))
    assert "before-after" not in drawn(page)
    assert "before-after" in drawn(build_page(some_data("named", [a_cause("cubic")])))


@pytest.mark.parametrize(("effect", "axis"), [("bias-walk", "visit within the run"), ("repeatability", "x-up")])
def test_scatter_is_shown_over_what_makes_it_with_how_far_its_size_reaches(effect: str, axis: str) -> None:
    size = [{"name": "size", "axis": None, "of": "common", "value": 1e-3, "std": 1e-5, "unit": "g"}]
    felt = np.eye(3)[np.arange(16) % 3]
    more: dict[str, Any] = {
        "signatures": (),
        "felt": felt,
        "floor": {"noise": 7e-5, "bias_walk": 1e-3, "repeatability_rad": 1e-3},
    }
    page = build_page(some_data("named", [a_cause(effect, parameters=size)], **more))
    assert page.lead is not None
    words = {t.text for t in ET.fromstring(page.lead.svg).iter("{http://www.w3.org/2000/svg}text")}
    assert {axis, "where 95 % of visits lie by the cause", "noise of one visit, 95 %"} <= words
    assert "The cause is right where most visits fill the orange" in page.lead.caption


def a_line(*serials: str) -> dict[str, Any]:
    """Two units that a cause makes fail, the first by more."""
    first, second = serials or ("SN0000", "SN0001")
    matrix = [[1e-5, 0.0, 0.0], [0.0, 0.0, 2e-5], [0.0, -1e-5, 0.0]]
    unit = {"serial": first, "offset": [0.4, 0.0, 0.0], "matrix": matrix, "before": "FAIL", "after": "PASS"}
    shown = {"unit": "mg", "units": [{**unit, "moves": 0.24}, {**unit, "serial": second, "moves": 0.1}]}
    counts = {"verdicts_changed": 2, "passed_before": 0, "passed_after": 2, "yield_before": 0.0, "yield_after": 1.0}
    return {**shown, **counts}


def test_the_gain_is_told_in_the_words_of_the_line() -> None:
    data = some_data("named", [a_cause("cubic")], line=a_line())
    page = build_page(data)
    assert "It shifts calibrated readings of SN0000 by 240 µg rms." in page.sentence
    assert "Without it 2 of 2 units would pass; 0 pass now." in page.sentence
    gain = section(page, "gain")
    assert "from 210 to 80 µg rms. It explains 97 %" in gain.text[0]
    assert (
        "0 of 2 units pass the recipe's limits as measured, 2 with the causes removed; 2 verdicts change."
        in gain.text[1]
    )
    wanted = ("SN0000", "0.240", "0.400", "0", "0", "10.0", "0", "0", "0", "0", "20.0", "FAIL → PASS")
    assert gain.tables[0].rows[0] == wanted


def test_pose_unknown_has_one_number_a_stop() -> None:
    many = some_data("named", [a_cause("cross-axis")])
    one = {k: getattr(many, k)[:, :1] for k in ("measured", "before", "after")}
    signs = (CauseSignature("cross-axis", many.signatures[0].values[:, :1]),)
    page = build_page(
        some_data("named", [a_cause("cross-axis")], axes=("along the stimulus",), signatures=signs, **one)
    )
    assert {"first", "heat-map-along-the-stimulus", "residual-time"} <= set(drawn(page))


def test_where_no_pose_is_known_cross_axis_is_drawn_over_the_product_that_lengths_follow() -> None:
    """Not over the visits, one after the other: they come in any order."""
    told = np.random.default_rng(2).standard_normal((16, 3))
    told /= np.linalg.norm(told, axis=1, keepdims=True)
    course = 1e-3 * (2 * told[:, :1] * told[:, 2:] + 0.3 * told[:, 1:2] * told[:, 2:])
    many = some_data("named", [a_cause("cross-axis")])
    one = {k: getattr(many, k)[:, :1] for k in ("measured", "before", "after")}
    signs = (CauseSignature("cross-axis", course),)
    page = build_page(
        some_data("named", [a_cause("cross-axis")], axes=("along the stimulus",), signatures=signs, told=told, **one)
    )
    assert page.lead is not None
    words = [t.text for t in ET.fromstring(page.lead.svg).iter("{http://www.w3.org/2000/svg}text")]
    assert {"product of what axes x and z feel, g²", "measured, mean of a group ± 95 %"} <= set(words)
    assert "cross-axis: the residual against what it depends on" in words


@pytest.mark.parametrize(
    ("cause", "words", "course"),
    [
        ("cubic", "what axis y feels, g", lambda a, b, t: a[:, 1] ** 4 + 0.2 * a[:, 0] ** 4),
        ("quadratic", "what axis z feels, g", lambda a, b, t: a[:, 2] ** 3),
        ("hysteresis", "previous minus present position on axis x × what it feels, g²",
         lambda a, b, t: np.sign(b[:, 0]) * np.abs(b[:, 0] * a[:, 0])),
        ("gain-temperature", "temperature above its mean × square of what axis z feels, °C·g²",
         lambda a, b, t: (t - t @ a[:, 2] ** 2 / (a[:, 2] ** 2).sum()) * a[:, 2] ** 2),
    ],
)  # fmt: skip
def test_where_no_pose_is_known_bends_are_drawn_over_what_they_depend_on(
    cause: str, words: str, course: Callable[[Floats, Floats, Floats], Floats]
) -> None:
    """Not over the visits, one after the other."""
    told = np.random.default_rng(2).standard_normal((16, 3))
    told /= np.linalg.norm(told, axis=1, keepdims=True)
    many = some_data("named", [a_cause(cause)])
    before = np.where(many.previous[:, None] >= 0, told[many.previous] - told, 0.0)
    moved = 1e-3 * course(told, before, many.values["temperature_degC"])[:, None]
    one = {k: getattr(many, k)[:, :1] for k in ("measured", "before", "after")}
    signs = (CauseSignature(cause, moved),)
    page = build_page(
        some_data("named", [a_cause(cause)], axes=("along the stimulus",), signatures=signs, told=told, **one)
    )
    assert page.lead is not None
    drawn_words = [t.text for t in ET.fromstring(page.lead.svg).iter("{http://www.w3.org/2000/svg}text")]
    assert {words, "measured, mean of a group ± 95 %"} <= set(drawn_words)


def test_one_unit_and_nothing_recorded_but_time() -> None:
    data = some_data("named", [a_cause("cubic")], units=1, values={"time_s": np.arange(8.0)})
    page = build_page(data)
    assert "residual-temperature" not in drawn(page)
    assert "it was not recorded or never changes: Residual over temperature" in section(page, "residuals").text[1]
    assert plot_axis(data, "unit") is None


def test_one_stop_only_still_makes_a_page() -> None:
    data = some_data("none", units=1)
    one = {k: getattr(data, k)[:1] for k in ("unit", "position", "run", "visit", "previous", "measured", "before")}
    page = build_page(some_data("none", units=1, values={"time_s": np.zeros(1)}, after=data.after[:1], **one))
    assert page.lead is None
    assert "Nothing. 1 cause was tested" in html(page, simulated=False)


def test_a_thousand_units_make_a_small_page_with_the_worst_of_them() -> None:
    units = tuple(f"unit:SN{i:04d}" for i in range(1000))
    data = some_data("named", [a_cause("offset-temperature", units)], units=1000)
    spike = data.before.copy()
    spike[8 * 777 + 3] = 0.05
    page = build_page(some_data("named", [a_cause("offset-temperature", units)], units=1000, before=spike))
    assert len(html(page, simulated=False).encode()) < 500_000
    figures = page.pictures()
    assert "SN0777" in figures["heat-map-x"]
    assert "40 of 1000 units" in figures["heat-map-x"]
    assert section(page, "cause-1").tables[0].caption.endswith("the 30 largest of 3000, the JSON document has all")
    # The one far stop is not thinned away: the axis reaches up to it.
    assert re.search(r">50<|>40<", figures["residual-position"])


@settings(max_examples=15, deadline=None)
@given(st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=30))
def test_no_serial_number_becomes_a_part_of_the_page(serial: str) -> None:
    hostile = f"<script>alert(1)</script>{serial}"
    cause = a_cause("offset-temperature", (f"unit:{hostile}", f"unit:{hostile}2"))
    data = some_data("named", [cause], names=(hostile, hostile + "2"), line=a_line(hostile, hostile + "2"))
    page = build_page(data)
    drawn(page)
    assert "<script" not in html(page, simulated=False)
    assert "&lt;script&gt;" in html(page, simulated=False)


def test_the_page_needs_nothing_from_elsewhere() -> None:
    text = html(build_page(some_data("named", [a_cause("cubic")])), simulated=False)
    outside = set(re.findall(r'(?:src|href)="([^"]*)"|url\(', text))
    assert not outside
    assert set(re.findall(r"https?://[^\"' <]+", text)) == {"http://www.w3.org/2000/svg"}
    assert text.count("<svg ") == text.count("</svg>") >= 10


def test_names_of_columns_are_marked_and_nothing_else_is_let_through() -> None:
    text = html(build_page(some_data("none", names=("`<b>x</b>`", "SN2"))), simulated=False)
    assert "record <code>since_power_s</code> in the samples" in text
    assert "<b>" not in text


@pytest.mark.parametrize(
    ("effect", "recorded", "printed"),
    [
        ("warm-up", (), "record `since_power_s` in the samples"),
        ("warm-up", ("since_power_s",), "powered long before"),
        ("temperature-rate", (), "record `temperature_degC` in the samples"),
        ("motor-tone", ("motor",), "record `started_s` in the samples"),
        ("cross-quadratic", (), "edges and corners"),
        ("gold-drift", (), "read a gold reference"),
    ],
)
def test_what_would_make_a_cause_testable(effect: str, recorded: tuple[str, ...], printed: str) -> None:
    assert printed in makes_testable(effect, recorded)


def test_lengths_needed_are_those_of_the_published_table() -> None:
    # Noncentral χ², 80 % power at 1 %: for 1, 3, 6, 12 and 36 free coefficients.
    assert [round(detectable_length(k), 2) for k in (1, 3, 6, 12, 36)] == [3.42, 3.93, 4.34, 4.85, 5.92]


def test_numbers_are_said_as_on_the_line() -> None:
    assert format_size(0.0021, "rad") == "2.1 mrad"
    assert format_size(3.1e-4, "g/degC") == "310 µg/°C"
    assert format_size(0.02, "1") == "2 %"
    assert format_size(3e-4, "1/g") == "300 ppm/g"
    assert format_size(-45.2, "uT") == "−45.2 µT"
    assert format_size(0.02, "deg/s") == "20 mdeg/s"
    assert format_size(1.2e-6, "1/deg/s") == "1.2 ppm/(deg/s)"
    assert format_size(2e-6, "1/deg/s²") == "2 ppm/(deg/s)²"
    assert format_size(0.02, "deg/s·s/degC") == "20 (mdeg/s)·s/°C"
    assert format_size(0.02, "deg/s/degC") == "20 mdeg/s/°C"
    assert format_size(2e-5, "1/uT") == "20 ppm/µT"
    assert unit_words("temperature × input, °C·deg/s²") == "temperature × input, °C·(deg/s)²"
    assert format_size(40.0, "s") == "40 s"
    assert format_interval(-3.1e-4, 1e-5, "g") == "−310 ± 20 µg"
    assert format_significant(1e5) == "100000"
    assert format_significant(float("nan")) == "–"


def test_an_unknown_is_not_called_noise() -> None:
    """The fitted floor has swallowed what is unknown; the samples within the stops have not."""
    page = build_page(some_data("unknown", unknown={"depends_on": ["time"]}, floor={"within_stops": 4e-5}))
    assert "the residual of 210 µg rms (noise: 40 µg)." in page.sentence
    assert ("noise alone", "40 µg rms") in page.cards


def test_many_causes_are_told_apart_in_a_row_of_names() -> None:
    run = {"recipe_change": "one run warmer", "separates": ["a", "b", "c"], "minutes": 2.0, "certainty": 0.95}
    page = build_page(some_data("named", [a_cause("cubic", indistinguishable_from=["b", "c"])], next_run=run))
    assert "to separate a, b, c. Chance that a single cause is named then: 95 %." in page.do


def test_a_formulas_curve_is_drawn_at_levels_that_there_are() -> None:
    """On eight tilts an axis feels squares of 0, a half and 1, each with the rounding of its pose."""
    rng = np.random.default_rng(3)
    level = np.repeat([0.0, 0.5, 1.0], [24, 16, 8]) + 1e-16 * rng.standard_normal(48)
    at = rng.uniform(20, 30, 48)
    formula = 1e-4 * level * (at - 25)
    curve = FormulaCurve("z", "temperature", "a_z²", at, level, formula + 1e-6 * rng.standard_normal(48), formula)
    drawn = draw_curve(curve, "g")
    for value in ("0", "0.5", "1"):
        assert f">a_z² about {value}<" in drawn
    assert "e−" not in drawn


def test_a_formulas_curve_is_smooth_and_has_a_middle_where_a_third_of_the_visits_have_one_level() -> None:
    """A wave drawn through the means of few visits would be a zigzag; half of the moves are nothing."""
    rng = np.random.default_rng(4)
    at = rng.uniform(0, 60, 120)
    level = np.where(rng.uniform(size=120) < 0.5, 0.0, rng.uniform(0.5, 2, 120) * rng.choice([-1, 1], 120))
    formula = 1e-4 * level * np.sin(at)
    x = np.linspace(0, 60, 400)
    course = np.stack([x, 1e-4 * np.sin(x)])
    plain = FormulaCurve("x", "time", "Δa_x", at, level, formula, formula, course, "unit:SN0007")
    drawn = draw_curve(plain, "g")
    assert "The formula on axis x, unit:SN0007" in drawn
    assert drawn.count(">Δa_x about ") == 3 and ">Δa_x about 0<" in drawn
    lines = [line for line in drawn.split("<") if line.startswith(("path", "polyline")) and line.count(" ") > 300]
    assert len(lines) == 3


def test_a_constant_that_a_cause_holds_fixed_has_no_interval() -> None:
    held = {"name": "about", "axis": None, "of": "common", "value": 24.0, "std": 0.0, "unit": "degC"}
    assert parameter_line(held).endswith("about 24 °C")
    assert parameter_line({**held, "std": 0.44}).endswith("about 24 ± 0.44 °C")


@pytest.mark.parametrize(("after", "falls"), [(1.2e-4, True), (3.1e-4, False)])
def test_a_residual_that_a_formula_does_not_lower_is_said_not_to_fall(after: float, falls: bool) -> None:
    """The score weighs readings by their noise, the residual does not."""
    gain = {"held_out_by": "visit", "rms_before": 2.1e-4, "rms_after": after, "log_score": 28.8, "std_error": 11.0}
    formula = {"formula": "reading_z += c · a_z²", "complete": False, "parameters": [], "gain": gain, "equivalent": []}
    unknown = {"depends_on": ["input"], "hypotheses": [formula]}
    said = " ".join(lines({"unknown": unknown, "baseline": {"unit": "g"}}))
    reported = " ".join(formula_sentences(some_data("unknown", unknown=unknown)))
    for text in (said, reported):
        assert ("does not fall" in text) is not falls
