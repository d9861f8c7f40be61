"""Patterns from recipes and products take linear time, and what cannot is refused in a sentence."""

import time

import pytest

from station.domain.core import patterns
from station.errors import UsageError


@pytest.mark.parametrize("pattern", [r"SN(0+)+$", r"(\w|\w\w)*b", r"(.*)*x", r"SN(\d+\s?)+;"])
def test_no_pattern_hangs(pattern: str) -> None:
    """Each of these takes exponential time in a back-tracking engine; sixty characters would outlast the shift."""
    began_s = time.process_time()
    assert not patterns.matches_whole(pattern, "SN" + "0" * 60 + "!")
    assert time.process_time() - began_s < 1.0


@pytest.mark.parametrize(("text", "fits"), [("SN0042", True), ("SN00420", False), ("xSN0042", False)])
def test_the_whole_text_fits_or_not(text: str, fits: bool) -> None:
    assert patterns.matches_whole(r"SN\d{4}", text) is fits


def test_groups_are_found_and_may_be_empty() -> None:
    assert patterns.groups_of(r"SN0*(\d+)", "SN0042") == ("42",)
    assert patterns.groups_of(r"SN(\d+)?", "SNX") == (None,)
    assert patterns.groups_of(r"SN(\d+)", "XX") is None


@pytest.mark.parametrize("pattern", [r"(?=SN)\w+", r"(\w)\1", "(", "(a{1000}){1000}"])
def test_what_needs_backtracking_is_refused_in_a_sentence(pattern: str, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(UsageError, match="cannot be used"):
        patterns.matches_whole(pattern, "SN0042")
    assert capfd.readouterr().err == "", "the library keeps quiet"
