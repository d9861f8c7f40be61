"""A fleet computed in portions: each result is kept as it comes, and what is kept is never computed again."""

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass

from station.domain.recipe.recipe import Recipe
from station.ports.fleet import Columns, Portion, PortionEngine, PortionResults, UnitSource
from station.ports.log_reader import Query, SelectedAttempt

#: Units of one portion: computed in a third of a second, so that a scheduler's cost is small and a loss bearable.
PORTION, PORTION_OF_FRAMES = 1024, 32

#: Opens a source, in whatever process; can be pickled.
OpenSource = Callable[[], UnitSource]


@dataclass(frozen=True, slots=True)
class FleetWork:
    """What one portion is computed from. recipe: JSON; numbers: the attempts in the source."""

    open_source: OpenSource
    recipe: str
    numbers: tuple[int, ...]
    from_frames: bool


@dataclass(frozen=True, slots=True)
class FleetJob:
    """What is computed of which units. name: of the job; code: the version that computes; given: a digest of whatever
    else its results depend on."""

    name: str
    recipe: Recipe
    query: Query
    code: str
    from_frames: bool = False
    given: str = ""

    @property
    def recipe_json(self) -> str:
        """The recipe as portions carry it."""
        return self.recipe.model_dump_json(by_alias=True)

    @property
    def key(self) -> str:
        """The same for the same job, recipe, query and code."""
        query = {name: value for name, value in asdict(self.query).items() if value is not None}
        return _digest(json.dumps([self.name, self.recipe_json, query, self.code, self.from_frames, self.given]))


@dataclass(frozen=True, slots=True)
class FleetPlan:
    """The portions of a job. units: how many attempts each has."""

    portions: tuple[Portion, ...]
    units: tuple[int, ...]

    @property
    def attempts(self) -> int:
        """How many attempts in all."""
        return sum(self.units)


class InProcess:
    """Computes portion after portion in this process."""

    def compute(self, function: Callable[..., Columns], portions: Iterable[Portion]) -> Iterator[tuple[str, Columns]]:
        """See PortionEngine.compute."""
        for portion in portions:
            yield portion.key, function(portion.work)


def plan_portions(job: FleetJob, sources: Sequence[OpenSource]) -> FleetPlan:
    """Cuts the attempts of all sources into portions. A portion's key follows from the attempts in it: a log that has
    grown keeps the results of all but its last portion. What is in several sources counts once. Errors: LogError."""
    size, recipe = PORTION_OF_FRAMES if job.from_frames else PORTION, job.recipe_json
    portions, units = [], []
    known = set[str]() if len(sources) > 1 else None
    for open_source in sources:
        with open_source() as source:
            for part in _parts(_unique(source.selection(job.query), known), size):
                work = FleetWork(open_source, recipe, tuple(a.number for a in part), job.from_frames)
                content = "\n".join(f"{a.attempt} {a.outcome}" for a in part)
                portions.append(Portion(_digest(f"{job.key}\n{content}"), work))
                units.append(len(part))
    return FleetPlan(tuple(portions), tuple(units))


def compute_missing(
    planned: FleetPlan,
    function: Callable[[FleetWork], Columns],
    engine: PortionEngine,
    results: PortionResults,
    progress: Callable[[int], None] = lambda _units: None,
) -> None:
    """Computes what has no result yet. progress: units done, those of earlier starts at once."""
    units = {portion.key: count for portion, count in zip(planned.portions, planned.units, strict=True)}
    missing = [portion for portion in planned.portions if not results.has(portion.key)]
    progress(planned.attempts - sum(units[portion.key] for portion in missing))
    for key, columns in engine.compute(function, missing):
        results.write(key, columns)
        progress(units[key])
    results.retain([portion.key for portion in planned.portions])


def _unique(selected: Iterable[SelectedAttempt], known: set[str] | None) -> Iterator[SelectedAttempt]:
    for attempt in selected:
        if known is None or attempt.attempt not in known:
            yield attempt
        if known is not None:
            known.add(attempt.attempt)


def _parts(selected: Iterable[SelectedAttempt], size: int) -> Iterator[list[SelectedAttempt]]:
    part: list[SelectedAttempt] = []
    for attempt in selected:
        part.append(attempt)
        if len(part) == size:
            yield part
            part = []
    if part:
        yield part


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:32]
