"""One trial: something is hidden by the blind tests' bench, and what the diagnosis made of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from station.diagnosis.results.diagnose import Diagnosis, diagnose
from station.diagnosis.search.alarm import NullDistribution
from station.domain.core.types import SampleTable
from station.domain.recipe.recipe import Recipe
from station.model.model_file import Model
from tests.blind.bench import FULL, HEAVY, WHITE, Floor, Hidden, hide
from tests.blind.hidden import KNOWN, WRONG_FORM
from tests.blind.inspection import diagnosis_of, null_of
from tests.blind.outside import OUTSIDE
from tests.blind.recipes import recipe as tilts

FLOORS: dict[str, Floor] = {"white": WHITE, "full": FULL, "t5": HEAVY}


@dataclass(frozen=True)
class Request:
    """What is hidden, by its name in the blind tests ("" for nothing), in which floor, how strongly: at strength d,
    or at `size` times its usual one."""

    name: str
    floor: str
    seed: int
    d: float | None = None
    size: float = 1.0
    runs: int = 3
    units: int = 4

    @property
    def right(self) -> str:
        """The id that must be named; "" where none may be."""
        return WRONG_FORM[self.name][0] if self.name in WRONG_FORM else self.name if self.name in KNOWN else ""

    @property
    def hidden(self) -> Hidden | None:
        """What is done to the samples."""
        if not self.name:
            return None
        return (KNOWN | {k: h for k, (_, h) in (WRONG_FORM | OUTSIDE).items()})[self.name]

    def __str__(self) -> str:
        much = f"d={self.d:g}" if self.d is not None else f"size×{self.size:g}"
        return f"{self.name or 'nothing'} {much} {self.floor} seed {self.seed}"


@dataclass(frozen=True)
class Trial:
    """What came of it.

    sets: the members of each named set, its leader first; words: of what is left unexplained; likely: the 95 % set of
    the first cause; strength and size: of what was hidden; probability of the first set.
    """

    request: Request
    alarmed: bool
    verdict: str
    sets: tuple[tuple[str, ...], ...]
    words: tuple[str, ...]
    likely: tuple[str, ...]
    strength: float
    size: float
    probability: float = 0.0

    @property
    def first(self) -> tuple[str, ...]:
        """The first set; empty where nothing was named."""
        return self.sets[0] if self.sets else ()

    @property
    def leads(self) -> bool:
        """Whether the right cause is named first."""
        return self.first[:1] == (self.request.right,)

    @property
    def among(self) -> bool:
        """Whether the right cause is named first, or is one that the first cannot be told from."""
        return self.request.right in self.first

    def miss(self) -> str:
        """What was said instead, for a person."""
        shown = "; ".join("/".join(s) for s in self.sets)
        return f"{self.request}: {self.verdict} [{shown}] {' '.join(self.words)}".rstrip()


def table_of(request: Request) -> tuple[Recipe, SampleTable, Mapping[str, float]]:
    """Recipe, samples, and what is true of them."""
    recipe = tilts(request.runs)
    table, truth = hide(
        recipe,
        request.hidden,
        request.seed,
        units=request.units,
        floor=FLOORS[request.floor],
        d=request.d,
        size=request.size,
    )
    return recipe, table, truth


def shown(request: Request, found: Diagnosis, truth: Mapping[str, float]) -> Trial:
    """A diagnosis as a trial."""
    searched = found.search_result
    sets = [(f.effect, *f.indistinguishable_from) for f in found.faults]
    sets += [(c.finding.name, *c.finding.indistinguishable_from) for c in found.causes]
    alarmed = bool(found.faults) or searched.statistics[0] > searched.threshold
    probability = searched.findings[0].probability if searched.findings else {}
    likely = credible(probability)
    first = found.causes[0].finding if found.causes else None
    members = () if first is None else (first.name, *first.indistinguishable_from)
    sure = 0.0 if first is None else sum(first.probability.get(name, 0.0) for name in members)
    return Trial(
        request, alarmed, found.verdict, tuple(sets), found.depends_on, likely, truth["d"], truth.get("size", 0.0), sure
    )


def credible(probability: Mapping[str, float], level: float = 0.95) -> tuple[str, ...]:
    """The likeliest causes that together hold `level`."""
    order = sorted(probability, key=lambda n: -probability[n])
    total = np.cumsum([probability[n] for n in order])
    return tuple(order[: int(np.searchsorted(total, level)) + 1])


@cache
def trial(request: Request) -> Trial:
    """Hides and diagnoses."""
    return tried(request)[0]


def tried(request: Request) -> tuple[Trial, Diagnosis]:
    """The same, with the whole diagnosis."""
    recipe, table, truth = table_of(request)
    found = diagnosis_of(recipe, table)
    return shown(request, found, truth), found


@dataclass(frozen=True)
class First:
    """What the first alarm says: its statistic, −log₁₀ p, its threshold, and whether a gross fault was found."""

    statistic: float
    threshold: float
    fault: bool

    @property
    def alarms(self) -> bool:
        """Whether anything is said to be wrong."""
        return self.fault or self.statistic > self.threshold


def first_diagnosis(request: Request) -> First:
    """The first alarm over the samples; the search that would follow an alarm is left out."""
    threshold = [np.inf]

    def never(problem: Any, fitted: Any, now: Any) -> NullDistribution:
        null = null_of(problem, fitted, now)
        threshold[0] = null.threshold
        return replace(null, threshold=np.inf)

    recipe, table, _ = table_of(request)
    found = diagnose(recipe, table, Model(), never)
    return First(found.search_result.statistics[0], threshold[0], bool(found.faults))


def named_ids() -> list[str]:
    """All that the diagnosis must name: causes of the library, and causes of another form."""
    return sorted(KNOWN) + sorted(WRONG_FORM)


def tell_misses(trials: Sequence[Trial], right: Sequence[bool]) -> None:
    """Prints what was said where it was not right."""
    for t, good in zip(trials, right, strict=True):
        if not good:
            print(f"    {t.miss()}", flush=True)
