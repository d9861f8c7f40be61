"""What the commands over a fleet share: sources, engine, results, progress."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from station.cli import _output
from station.config.recipes import recipe_hash
from station.errors import LogError
from station.messages import Message, render
from station.ports.fleet import Columns, ColumnType, PortionResults
from station.ports.log_reader import Query
from station.service.fleet import FleetJob, FleetPlan, FleetWork, compute_missing, plan_portions
from station.wiring.fleet import check_scheduler, open_engine, open_results, open_source, openers


@dataclass(frozen=True, slots=True)
class FleetRequest:
    """sources: logs, plants or folders of tables; results: a folder that keeps them, None: they go when all is said."""

    sources: tuple[Path, ...]
    processes: int | None = None
    scheduler: str | None = None
    results: Path | None = None


def named_sources(db: Sequence[Path] | None, config: Path | None) -> tuple[Path, ...]:
    """Those named on the command line, or else the log that config.yaml names. Errors: ConfigError."""
    if db:
        return tuple(db)
    from station.config.settings import load_settings

    return (Path(load_settings(config).database),)


def describe_sources(sources: Sequence[Path]) -> list[dict[str, Any]]:
    """Where the units come from, with the newest record of each log. Errors: LogError."""
    found = []
    for path in sources:
        with open_source(path) as source:
            found.append({"location": source.location, "head": asdict(source.head())})
    return found


def recipes_in_use(sources: Sequence[Path], query: Query) -> list[str]:
    """The JSON of every recipe that the attempts were made with. Errors: LogError where there is no attempt."""
    found = []
    for path in sources:
        with open_source(path) as source:
            found += source.recipes(query)
            where = source.location
    if not found:
        raise LogError("backtest-no-attempts", log=where, recipe=str(query.recipe_name))
    return found


@contextmanager
def computed(
    request: FleetRequest, job: FleetJob, function: Callable[[FleetWork], Columns], types: Mapping[str, ColumnType]
) -> Iterator[tuple[FleetPlan, PortionResults]]:
    """The job's portions with their results, those of earlier starts taken as they are.

    Errors: LogError, StoreFault, StationFault, InputError.
    """
    check_scheduler(request.scheduler)
    with _output.progress() as bar:
        task = bar.add_task("reading", total=None)
        planned = plan_portions(job, openers(request.sources))
        bar.update(task, description="computing", total=planned.attempts)
        about = {
            "name": job.name,
            "recipe": {"name": job.recipe.name, "version": job.recipe.version, "hash": recipe_hash(job.recipe)},
            "query": {name: value for name, value in asdict(job.query).items() if value is not None},
            "code": job.code,
            "sources": describe_sources(request.sources),
        }
        with open_results(request.results, job, types, about) as results:
            present = sum(results.has(portion.key) for portion in planned.portions)
            if present:
                _output.print_remark(render(Message("fleet-goes-on", present=present, all=len(planned.portions))))
            if present < len(planned.portions):
                with open_engine(planned, request.processes, request.scheduler) as engine:
                    compute_missing(*(planned, function, engine, results), lambda units: bar.advance(task, units))
            bar.stop()
            yield planned, results
