"""Diagnoses a hidden thing; null distributions are drawn once for each kind of campaign."""

from typing import Any

from station.diagnosis.results.diagnose import Diagnosis, diagnose
from station.diagnosis.search import alarm
from station.diagnosis.search.alarm import NullDistribution
from station.domain.core.types import SampleTable
from station.domain.recipe.recipe import Recipe
from station.model.model_file import Model

_NULLS: dict[str, NullDistribution] = {}


def null_of(problem: Any, fitted: Any, now: Any) -> NullDistribution:
    """The null distribution of a kind of campaign."""
    key = alarm.cache_key(problem, fitted, now, 1)
    if key not in _NULLS:
        _NULLS[key] = alarm.bootstrap(problem, fitted, now, 1)
    return _NULLS[key]


def diagnosis_of(recipe: Recipe, table: SampleTable, model: Model | None = None) -> Diagnosis:
    """The diagnosis of a table."""
    return diagnose(recipe, table, model or Model(), null_of)
