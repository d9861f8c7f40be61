"""Where a job over a fleet reads its units, what computes it, and where its results go."""

import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any

from station.adapters.fleet.results import ParquetResults
from station.adapters.samples.fleet_reading import FleetTables
from station.files.code_version import code_version
from station.files.real_path import real_path
from station.ports.fleet import ColumnType, PortionEngine, UnitSource
from station.service.fleet import FleetJob, FleetPlan, InProcess, OpenSource
from station.wiring.logs import open_log, plant_address
from station.wiring.process_memory import retain_freed_memory

__all__ = ["code_version", "open_engine", "open_results", "open_source", "openers"]


def open_source(path: Path) -> UnitSource:
    """A log, a plant at an address of PostgreSQL, or a folder of tables. Errors: LogError."""
    return FleetTables(path) if not plant_address(path) and path.is_dir() else open_log(path)


def openers(paths: Sequence[Path]) -> list[OpenSource]:
    """What each portion opens its source by, in whatever process: files by their full paths."""
    return [partial(open_source, path if plant_address(path) else real_path(path)) for path in paths]


def check_scheduler(scheduler: str | None) -> None:
    """Before anything is read or written. Errors: InputError where it is no address."""
    if scheduler:
        from station.adapters.fleet.dask_engine import refuse_no_address

        refuse_no_address(scheduler)


def open_engine(
    planned: FleetPlan, processes: int | None, scheduler: str | None
) -> AbstractContextManager[PortionEngine]:
    """A cluster at an address; else so many processes of this machine, one a processor where left out; else, where
    there is nothing to share, this process. Errors: StationFault, InputError."""
    workers = min(processes or os.cpu_count() or 1, len(planned.portions))
    if not scheduler and workers <= 1:
        retain_freed_memory()
        return nullcontext(InProcess())
    from station.adapters.fleet.dask_engine import DaskEngine

    return DaskEngine(scheduler or "", workers)


@contextmanager
def open_results(
    folder: Path | None, job: FleetJob, types: Mapping[str, ColumnType], about: Mapping[str, Any]
) -> Iterator[ParquetResults]:
    """Results in a folder, those of earlier starts among them; left out: in one that goes when the block ends.

    Errors: StoreFault.
    """
    name = f"{job.name}-{job.key[:12]}"
    if folder is not None:
        yield ParquetResults(folder, name, types, about)
        return
    with tempfile.TemporaryDirectory(prefix="station-fleet-") as temporary:
        yield ParquetResults(Path(temporary), name, types, about)
