"""Diagnoses a hidden thing; null distributions are drawn once for each kind of campaign.

From a quarter of the null sets in every run of the suite: what is hidden there stands far above the threshold, or far
below. `make blind` and `make test ALL=1` draw them all.
"""

from typing import Any

from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.results.diagnose import Diagnosis, diagnose
from station.diagnosis.search import alarm
from station.diagnosis.search.alarm import NullDistribution
from station.diagnosis.search.cause_search import SearchResult, search_causes
from station.diagnosis.search.null_simulation import NULL_SETS
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.domain.core.types import SampleTable
from station.domain.recipe.recipe import Recipe
from station.model.model_file import Model
from tests.portion import WHOLE

#: Null sets of a kind of campaign.
SETS = NULL_SETS if WHOLE else NULL_SETS // 4
_NULLS: dict[str, NullDistribution] = {}


def null_of(problem: Any, fitted: Any, now: Any) -> NullDistribution:
    """The null distribution of a kind of campaign."""
    key = alarm.cache_key(problem, fitted, now, 1)
    if key not in _NULLS:
        _NULLS[key] = alarm.bootstrap(problem, fitted, now, 1, SETS)
    return _NULLS[key]


def searched(recipe: Recipe, table: SampleTable) -> SearchResult:
    """What a search among the causes finds, without the formulas that follow it."""
    allowance = FloorAllowance.of(recipe, Model())
    return search_causes(initial_problem(reduce_samples(recipe, table), allowance), null_of)


def diagnosis_of(recipe: Recipe, table: SampleTable, model: Model | None = None) -> Diagnosis:
    """The diagnosis of a table."""
    return diagnose(recipe, table, model or Model(), null_of)
