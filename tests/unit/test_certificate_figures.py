"""Figures of a certificate: digits of an uncertainty, units beside a quantity, the risk of all limits together."""

import unicodedata
from typing import Any

import pytest

from station.domain.methods import coefficients
from station.messages import Message
from station.reporting.certificate import fonts, pdf, result_sections
from station.reporting.certificate.facts import any_false_accept
from station.reporting.number_text import format_to_uncertainty, quantity_in
from station.reporting.words import words_of


@pytest.mark.parametrize(
    ("value", "spread", "shown"),
    [
        (0.98993, 9.98e-5, "0.98993"),
        (9.98e-5, 9.98e-5, "0.00010"),
        (9.94e-5, 9.94e-5, "0.000099"),
        (0.0995, 0.0995, "0.10"),
        (1.0, 0.0314, "1.000"),
        (-0.00004, 0.0034, "0.0000"),
        (118.6789, 0.23, "118.68"),
    ],
)
def test_a_figure_ends_with_the_second_digit_of_its_rounded_uncertainty(
    value: float, spread: float, shown: str
) -> None:
    assert format_to_uncertainty(value, spread) == shown


def test_a_unit_that_is_a_quotient_stands_in_brackets() -> None:
    assert quantity_in("offset x", "deg/s") == "offset x / (deg/s)"
    assert quantity_in("offset x", "uT") == "offset x / µT"


def test_the_risk_of_all_limits_is_no_less_than_that_of_any() -> None:
    decided: list[dict[str, Any]] = [
        {"what": "offset x", "false_accept": 0.002},
        {"what": "verification z-up", "false_accept": 0.01},
        {"what": "noise", "false_accept": None},
    ]
    assert any_false_accept({"outcome": "PASS", "false_accept": 0.002}, decided) == pytest.approx(0.012)
    assert any_false_accept({"outcome": "FAIL", "false_accept": 0.0}, decided) == 0.0, "it was not accepted"
    assert any_false_accept({"outcome": "PASS"}, decided) is None, "an older log has none"
    assert any_false_accept({"outcome": "PASS", "false_accept": 0.9}, [{"what": "tilt", "false_accept": 0.9}]) == 1.0


@pytest.mark.parametrize("language", ["en", "de"])
def test_no_word_of_a_head_is_broken(language: str) -> None:
    """Of the tables with seven columns, which are the narrowest."""
    words = words_of(language)
    for heads in (result_sections.COEFFICIENTS, result_sections.DECISIONS):
        for head, room in zip(heads, pdf.column_widths(len(heads)), strict=True):
            text = words.render(Message(f"head-{head}"))
            widest = max(pdf.cell_text_width(word) for word in text.split())
            assert widest <= room, (text, widest, room)
    assert pdf.cell_text_width(words.render(Message("certificate-assumed"))) <= pdf.column_widths(7)[2]
    for name in coefficients.NAMES:
        assert pdf.cell_text_width(words.term(name)) <= pdf.column_widths(7)[0], name


@pytest.mark.parametrize(
    "name",
    ["Łódź", "Žižkov s.r.o., Přesné měření", "Şişli, İstanbul", "Nguyễn Thị Đặng Ơn", "Ķīmija", "Győr", "Iași", "Ærø",
     "ẞ", "Ρόδος", "Привет, Ђорђе", "U ≤ 0.1 · √2 ± 5 µm → σ² ≈ ∞"],
)  # fmt: skip
def test_letters_of_every_alphabet_of_europe_stand_in_the_file_itself(name: str) -> None:
    """Also where accents come as characters of their own, as macOS writes them."""
    assert list(fonts.runs(name, fonts.BOLD)) == [(fonts.BOLD, name)]
    assert list(fonts.runs(unicodedata.normalize("NFD", name), fonts.REGULAR)) == [(fonts.REGULAR, name)]


def test_other_letters_are_the_readers() -> None:
    shown = list(fonts.runs("Firma 校准实验室, 서울\n🙂", fonts.REGULAR))
    assert shown == [
        (fonts.REGULAR, "Firma "),
        ("STSong-Light", "校准实验室"),
        (fonts.REGULAR, ", "),
        ("HYSMyeongJo-Medium", "서울"),
        (fonts.REGULAR, " 🙂"),
    ]


@pytest.mark.parametrize("language", ["en", "de"])
def test_heads_of_a_budget_of_many_causes_are_smaller_not_broken(language: str) -> None:
    words = words_of(language)
    heads = ["", *(words.term(cause) for cause in ("base tilt", "quantisation", "reproducibility", "temperature"))] * 2
    rooms = pdf.column_widths(len(heads))
    size = pdf.head_size(heads, rooms)
    widest = max(pdf.cell_text_width(w) / room for h, room in zip(heads, rooms, strict=True) for w in h.split())
    assert size < 8 and widest * size / 8 == pytest.approx(1.0)
    assert pdf.head_size(["u", "k"], [90.0, 90.0]) == 8
