"""Serials that differ by leading zeros are one device number."""

import pytest

from station.domain.recipe import serial
from station.errors import UsageError
from tests.fakes import tumble

RECIPE = tumble.recipe("six-point")


def test_every_spelling_of_a_number_is_told_and_each_is_the_same_unit() -> None:
    for text in ("SN0042", "42", "SN", "A1-007", "SN000000000000000007", "1-2-3-4-5-6"):
        spelt = serial.spellings(text)
        assert text in spelt
        assert {serial.canonical(each) for each in spelt} == {serial.canonical(text)}
        assert len(spelt) == len(set(spelt)) <= 400
    assert {"SN42", "SN042", "SN0000000042"} <= set(serial.spellings("SN0042"))


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("SN0001", "SN00001", True),
        ("SN1", "SN001", True),
        ("A1-007", "A01-7", True),
        ("SN10", "SN100", False),
        ("SN0", "SN00", True),
        ("SN01", "SN10", False),
        ("sn1", "SN1", False),
    ],
)
def test_leading_zeros_make_no_other_unit(one: str, other: str, *, same: bool) -> None:
    assert (serial.canonical(one) == serial.canonical(other)) is same
    if same:
        with pytest.raises(UsageError, match="mean the same device number"):
            serial.check_all((one, other), RECIPE)
    else:
        assert serial.check_all((one, other), RECIPE) == (one, other)
