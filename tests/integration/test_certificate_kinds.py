"""The paper of each kind of sensor and method, read out of its PDF as an auditor reads it (ISO/IEC 17025, 7.8)."""

import re
from io import BytesIO
from typing import Any

import pypdf
import pytest

from station.adapters.store.reader import SqliteLogReader
from station.ports.log_reader import Query
from station.reporting.certificate.pdf import pdf
from station.reporting.words import words_of
from station.service.certificates import certificate_of
from tests.fakes import fixture_run

BRIEF: dict[str, Any] = {"settle": {"time_s": 0.1}, "dwell": {"time_s": 0.1}}
NO_WRITES: dict[str, Any] = {"product": "sick-tmm88d", "verify": None}
#: Recipe, what is changed in it, its unit, how many coefficients it estimates, and how many axes the device has.
KINDS: dict[str, tuple[str, dict[str, Any], str, int, int]] = {
    "inclinometer": ("inclinometer-n-point", BRIEF, "deg", 6, 2),
    "zero alone": ("inclinometer-zero", BRIEF, "deg", 2, 2),
    "nothing written": ("six-point", NO_WRITES | BRIEF, "g", 12, 3),
    "gyroscope": ("gyroscope-three-point", {}, "deg/s", 6, 3),
    "magnetometer": ("magnetometer-n-point", BRIEF, "µT", 12, 3),
    "one-point": ("one-point", {}, "g", 3, 3),
    "three-point": ("three-point", BRIEF, "g", 6, 3),
    "n-point": ("n-point", BRIEF, "g", 12, 3),
}


@pytest.fixture(scope="module", params=KINDS)
def paper(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, list[str], str]:
    """The kind, the text of each page, and the certificate's number."""
    name, changed, *_ = KINDS[request.param]
    folder = tmp_path_factory.mktemp("kind")
    generous = {"rule": "simple", "offset": 20.0}
    ran = fixture_run.run(folder, recipe=fixture_run.recipe(folder, name, limits=generous, **changed), seed=3)
    assert ran.results["SN0001"].outcome == "PASS", ran.results["SN0001"].reasons
    with SqliteLogReader(folder / "station.db") as log:
        made = certificate_of(log, log.attempts(Query(serial="SN0001"))[0], words_of("en"))
    pages = [page.extract_text() for page in pypdf.PdfReader(BytesIO(pdf(made))).pages]
    return request.param, pages, made.number


def lines(pages: list[str], after: str, before: str) -> list[str]:
    """What stands between two headings."""
    return "\n".join(pages).partition(after)[2].partition(before)[0].splitlines()


def test_each_page_bears_the_number_its_place_and_the_mark(paper: tuple[str, list[str], str]) -> None:
    _, pages, number = paper
    for at, page in enumerate(pages, 1):
        assert f"SN0001 · {number} · page {at} of {len(pages)}" in page
        assert "SIMULATED" in page


def test_each_coefficient_of_the_device_has_value_unit_k_and_expanded_uncertainty(
    paper: tuple[str, list[str], str],
) -> None:
    kind, pages, _ = paper
    *_, unit, estimated, axes = KINDS[kind]
    shown = "\n".join(lines(pages, "Results: measured", "Limits and decisions"))
    assert len(re.findall(r"^(?:offset|gain|cross-axis) [xyz]", shown, re.M)) == axes + axes**2
    number = r"−?[\d.]+(?:e[−\d]+)?"
    row = rf"(?:offset|gain|cross-axis) [xyz](?: from [xyz])?\n{number}\n{number}\n(?:\d+|∞)\n{number}\n{number}\n(\S+)"
    units = re.findall(row, shown)
    assert len(units) == estimated
    assert set(units) <= {unit, "1"} and units[0] == unit


def test_found_and_left_have_units_where_the_device_keeps_a_calibration(paper: tuple[str, list[str], str]) -> None:
    kind, pages, _ = paper
    text = "\n".join(pages)
    assert ("Calibration as found and as left" in text) is (kind != "nothing written")
    assert ("the device keeps no calibration" in text) is (kind == "nothing written")
    held = lines(pages, "Calibration as found and as left", "Objects written")
    assert held.count(KINDS[kind][2]) == (0 if kind == "nothing written" else KINDS[kind][4])
    assert "unlock" not in text, "the maker's key is nobody's business"


def test_the_reference_is_described_by_what_the_sensor_feels(paper: tuple[str, list[str], str]) -> None:
    kind, pages, _ = paper
    reference = " ".join(lines(pages, "\nReference\n", "Contributions as stated"))
    has_magnitude = kind not in ("inclinometer", "zero alone", "gyroscope")
    assert ("Relative standard uncertainty of the magnitude" in reference) is has_magnitude
    assert ("0.01 deg/s" in reference) is (kind == "gyroscope")
    assert ("Heading of the x axis, clockwise from north 0 degrees" in reference) is (kind == "gyroscope")
    assert "natural constant" not in reference


def test_no_section_is_empty_and_what_must_be_declared_is(paper: tuple[str, list[str], str]) -> None:
    kind, pages, _ = paper
    text = "\n".join(pages)
    for words in (
        "relate only to the item",
        "no accredited calibration",
        "traceability to the SI is not claimed",
        "reproduced in full only",
        "covers the value with a probability of 95 %",
    ):
        assert words in text
    assert not re.search(r"golden register|limits\.process\.|; state ", text), (
        "what the laboratory may do is not its customer's"
    )
    assert ("1 g is 9.80665" in text) is (KINDS[kind][2] == "g")
    assert "Visits" not in text or kind not in ("zero alone", "one-point"), "nothing is left over"
    assert not re.search(r"\n(?:Visits|Traceability|Limits and decisions|Verification through.*)\n(?:[A-Z])", text)


def test_limits_say_of_what_they_are(paper: tuple[str, list[str], str]) -> None:
    kind, pages, _ = paper
    text, unit = "\n".join(pages), KINDS[kind][2]
    limits = lines(pages, "Limits and decisions", "Uncertainty budget")
    assert (f"offset x / ({unit})" if "/" in unit else f"offset x / {unit}") in limits
    assert "gain x" not in limits, "a limit on a gain is on what it differs from 1"
    assert "anything is beyond its limit" in " ".join(text.split()) and "failing if measured again" in text


def test_stimulus_and_reading_of_each_position_stand_on_it(paper: tuple[str, list[str], str]) -> None:
    kind, pages, _ = paper
    text = " ".join(lines(pages, "Readings at each position", "Where this comes from"))
    for axis in "xyz"[: KINDS[kind][4]]:
        assert f"stimulus {axis}" in text and re.search(rf"mean\s+reading\s+{axis}", text)


def test_contributions_are_named_in_words_and_the_thermometer_is_one(paper: tuple[str, list[str], str]) -> None:
    _, pages, _ = paper
    named = " ".join(lines(pages, "Contributions as stated or assumed", "Where this comes from"))
    assert "runs (device.turn_on_std)" in named
    assert ("thermometer (reference" in named) is ("Temperature\nnot measured" not in "\n".join(pages))
