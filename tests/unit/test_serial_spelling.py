"""Serials that differ by leading zeros are one device number."""

import pytest

from station.domain.recipe import serial
from station.errors import UsageError
from tests.fakes import tumble

RECIPE = tumble.recipe("six-point")


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
        with pytest.raises(UsageError, match="are one device number"):
            serial.check_all((one, other), RECIPE)
    else:
        assert serial.check_all((one, other), RECIPE) == (one, other)
