"""Printed serials: pattern, check digit, twice, and everything a scanner may hand over by mistake."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.config.recipes import load_recipe
from station.domain.recipe import serial
from station.domain.recipe.recipe import Recipe
from station.errors import UsageError


def recipe(**change: object) -> Recipe:
    return load_recipe("six-point").model_copy(update=change)


def test_a_matching_serial_is_given_back() -> None:
    assert serial.check("SN0042", recipe()) == "SN0042"


@pytest.mark.parametrize(
    "text",
    ["", "SN1", "sn0042", "SN0042\n", " SN0042", "SN0042'; DROP TABLE attempt;--", "../SN0042", "SN004\u202e2",
     "SN\u0660\u0661\u0662\u0663", "S" * 10_000_000, "SN0042\x00", "\x1b[2J"],
)  # fmt: skip
def test_anything_else_is_refused_in_one_short_sentence(text: str) -> None:
    with pytest.raises(UsageError) as caught:
        serial.check(text, recipe())
    assert len(caught.value.sentence) < 250
    assert caught.value.sentence.isprintable()


def test_no_serial_comes_twice() -> None:
    with pytest.raises(UsageError, match=r"'SN0002' is listed twice"):
        serial.check_all(["SN0001", "SN0002", "SN0002"], recipe())
    assert serial.check_all(["SN0001", "SN0002"], recipe()) == ("SN0001", "SN0002")


@pytest.mark.parametrize(
    ("number", "right"), [("79927398713", True), ("79927398710", False), ("7", False), ("", False)]
)
def test_luhn_known_answers(number: str, right: bool) -> None:
    assert serial.mod10(number) is right


def test_code_39_known_answer() -> None:
    # The usual worked example of Code 39: 12345ABCDE/ sums to 115, 115 mod 43 = 29, which is T.
    assert serial.mod43("12345ABCDE/T")
    assert not serial.mod43("12345ABCDE/S")
    assert not serial.mod43("12345abcde/T")


@given(st.text("0123456789", min_size=2, max_size=20), st.integers(0, 19), st.integers(1, 9))
def test_luhn_sees_every_single_wrong_digit(number: str, place: int, shift: int) -> None:
    right = next(number + str(d) for d in range(10) if serial.mod10(number + str(d)))
    at = place % len(right)
    wrong = right[:at] + str((int(right[at]) + shift) % 10) + right[at + 1 :]
    assert not serial.mod10(wrong)


def test_the_check_digit_is_asked_for_by_the_recipe() -> None:
    assert serial.check("SN79927398713", recipe(check_digit="mod10", serial_pattern=None))
    with pytest.raises(UsageError, match="wrong mod10 check digit"):
        serial.check("SN79927398710", recipe(check_digit="mod10", serial_pattern=None))
