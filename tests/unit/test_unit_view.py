"""What a unit's page says of the value that decided: how far from its limit, and whether it is the unit or the nest."""

from typing import Any

import pytest

from station.reporting.drawing.limit_bar import LimitBar
from station.reporting.line import unit_view
from station.reporting.line.statistics import AttemptValues
from station.reporting.words import words_of

WORDS = words_of("en")
LIMITS = (0.972, 1.028)


def attempt(serial: str, nest: str, value: float) -> AttemptValues:
    started_ns = 1_795_000_000_000_000_000 + int(serial) * 10**9
    return AttemptValues(serial, nest, started_ns, "PASS", {"gain x": value}, {}, {})


def nest_sentence(nest_a: list[float], others: list[float], limits: tuple[float, float] | None = LIMITS) -> str:
    own = attempt("0", "A", 0.96)
    day = [own, *(attempt(str(i + 1), "A", v) for i, v in enumerate(nest_a))]
    day += [attempt(str(i + 101), "B", v) for i, v in enumerate(others)]
    return unit_view.nest_sentence(day, own, "gain x", limits, WORDS)


def test_the_unit_or_the_nest() -> None:
    assert nest_sentence([], [1.0] * 9) == ""
    assert "that day: 1 other unit, median" in nest_sentence([1.0], [1.0] * 9)
    assert nest_sentence([1.0] * 4, [1.0] * 9).startswith("The same nest (A) that day: 4 other units")
    assert nest_sentence([1.0] * 9, [1.0] * 9, None).startswith("The same nest (A) that day: 9 other units")
    assert nest_sentence([1.0] * 9, [1.0] * 9).startswith("The unit, not the nest: 9 other units in A met this limit")
    assert nest_sentence([0.95] * 3 + [1.0] * 6, [1.0] * 9).startswith(
        "Look at the nest: 3 of 9 other units in A missed"
    )
    assert nest_sentence([0.95] + [1.0] * 9, [1.0] * 9).startswith("In the same nest (A) 1 of 10 other units missed")
    assert nest_sentence([0.95] * 3 + [1.0] * 6, [0.95] * 3 + [1.0] * 6).startswith(
        "In the same nest (A) 3 of 9 other units"
    )


@pytest.mark.parametrize(
    ("value", "sentence", "accepted"),
    [
        (-0.031, "0.003 beyond the limit: 1.0 × U", False),
        (-0.026, "0.002 inside the limit: less than the guard band of 0.003", False),
        (-0.022, "0.006 within the limit: 2.0 × U", True),
    ],
)
def test_a_value_within_its_limit_by_less_than_the_guard_band_is_not_called_good(
    value: float, sentence: str, accepted: bool
) -> None:
    decision: dict[str, Any] = {"what": "gain x", "value": value, "limit": 0.028, "guard": 0.003, "expanded": 0.003}
    decision |= {"unit": "1", "margin": 0.028 - 0.003 - abs(value)}
    found = unit_view.deciding({"decisions": [decision]}, [], WORDS)
    assert found is not None
    assert found.margin == sentence
    drawn = str(found.chart)
    assert ('fill="#ae131f"' in drawn) is not accepted
    assert ('fill="#0b6a3d"' in drawn) is accepted
    assert LimitBar(1 + value, 0.003, *LIMITS, 1.0, ("", "", "", ""), 0.003).accepted is accepted


def test_the_day_is_told_by_the_clock() -> None:
    day = [attempt(str(1800 * i), "A", 1.0 + 0.001 * i) for i in range(9)]
    drawn = unit_view.neighbours(day, day[3], "gain x", LIMITS, WORDS, lambda ns: f"at {ns // 10**9}")
    assert drawn is not None
    assert ">at 179500" in str(drawn)
    assert ">LSL 0.972<" in str(drawn)
