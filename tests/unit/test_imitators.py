"""Which causes give way to a formula that says the same."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from station.diagnosis.results import imitators
from station.diagnosis.results.imitators import Explanation, simplest_explanation


@pytest.fixture(params=[0, 1])
def terms(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """Terms of a formula that leaves only noise, and the first of which is the law of the first cause offered."""

    def written_in(alone: Any, causes: Sequence[Any], last: Any) -> tuple[Any, ...]:
        return tuple(causes[:1])

    formula = SimpleNamespace(terms=("term",) * request.param, quiet=True)
    monkeypatch.setattr(imitators, "propose_formula", lambda *_, **__: formula)
    monkeypatch.setattr(imitators, "_written_in", written_in)
    return int(request.param)


def explained(causes: Sequence[Any], doubted: Sequence[Any] | None) -> Explanation:
    anything: Any = None
    return simplest_explanation(anything, anything, causes, anything, whole=True, doubted=doubted)


def test_a_cause_stays_whose_place_a_term_would_take(terms: int) -> None:
    causes: list[Any] = [object(), object()]
    assert explained(causes, None).causes == tuple(causes if terms else causes[:1])


def test_a_doubted_cause_takes_no_other_with_it(terms: int) -> None:
    causes: list[Any] = [object(), object(), object()]
    assert explained(causes, causes[:1]).causes == tuple(causes[1:2])
