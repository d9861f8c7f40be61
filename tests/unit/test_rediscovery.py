"""What is taken out of the library is found again as a formula; `benchmarks/discovery.py` does so with every cause."""

from typing import Any

import pytest

from station.diagnosis.discovery import chance
from station.diagnosis.discovery.discover import ThresholdOf
from tests.blind.rediscovery import is_rediscovered, rediscover


@pytest.fixture(scope="module")
def threshold_of() -> ThresholdOf:
    """The score by chance, drawn once: the campaigns are of one kind."""
    drawn: list[float] = []

    def found(problem: Any, fitted: Any, scans: Any) -> float:
        drawn.extend([] if drawn else [chance.threshold(problem, fitted, scans, 1)])
        return drawn[0]

    return found


@pytest.mark.parametrize(("name", "seed"), [("cross-axis", 11), ("vibration-rectification", 11), ("lever-arm", 18)])
def test_a_cause_taken_out_of_the_library_is_found_again_in_its_form(
    name: str, seed: int, threshold_of: ThresholdOf
) -> None:
    found = rediscover(name, seed, threshold_of)
    assert found.terms[0].score > found.threshold
    assert is_rediscovered(name, found)
