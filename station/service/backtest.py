"""Every stored unit computed again under another recipe, in as many processes as there are processors."""

import json
import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.domain.evaluation import backtest, pipeline, reduced_visits_document
from station.domain.evaluation.backtest import BacktestResult, PreviousResult
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.planning import design
from station.domain.product import product_record, writeback
from station.domain.recipe import references
from station.domain.recipe.recipe import Recipe
from station.errors import StationFault
from station.ports.log_reader import Attempt, LogReader, Query, ReducedAttempt
from station.service.recompute import parse_recipe_and_product, refit_attempt, stored_visits

#: Attempts of one task: enough to be solved together, few enough to show progress.
PORTION, PORTION_OF_FRAMES = 1024, 32

#: Opens the log, in whatever process.
OpenLog = Callable[[], LogReader]


@dataclass(frozen=True, slots=True)
class Task:
    """What one process does at a time. recipe: JSON; numbers: records of the attempts; open_log can be pickled."""

    open_log: OpenLog
    recipe: str
    numbers: tuple[int, ...]
    from_frames: bool


def run(
    open_log: OpenLog,
    attempts: Sequence[Attempt],
    recipe: Recipe,
    *,
    from_frames: bool = False,
    processes: int | None = None,
    progress: Callable[[int], None] = lambda _done: None,
) -> BacktestResult:
    """Compares all attempts. open_log: opens the log in each process. from_frames: from raw frames, not from the
    reduced visits. progress: attempts done.

    Errors: RecipeError when the recipe cannot be computed at all, LogError, StationFault.
    """
    design.check(recipe)
    portion = PORTION_OF_FRAMES if from_frames else PORTION
    numbers = [a.number for a in attempts]
    text = recipe.model_dump_json(by_alias=True)
    parts = [tuple(numbers[i : i + portion]) for i in range(0, len(numbers), portion)]
    tasks = [Task(open_log, text, part, from_frames) for part in parts]
    workers = min(processes or os.cpu_count() or 1, len(tasks))
    if workers <= 1:
        return BacktestResult.join([_with_progress(compute_portion(task), task, progress) for task in tasks])
    try:
        with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
            done = zip(pool.map(compute_portion, tasks), tasks, strict=True)
            return BacktestResult.join([_with_progress(part, task, progress) for part, task in done])
    except BrokenProcessPool as exc:
        raise StationFault("backtest-process-killed") from exc


def compute_portion(task: Task) -> BacktestResult:
    """One portion, in whatever process."""
    recipe = Recipe.model_validate_json(task.recipe)
    with task.open_log() as log:
        rows = log.reduced(task.numbers)
        results = _from_frames(log, rows, recipe) if task.from_frames else _from_reduced(log, rows, recipe)
    return backtest.compare([_before(row) for row in rows], results, from_samples=task.from_frames)


def _with_progress(part: BacktestResult, task: Task, progress: Callable[[int], None]) -> BacktestResult:
    progress(len(task.numbers))
    return part


def _from_reduced(log: LogReader, rows: Sequence[ReducedAttempt], recipe: Recipe) -> list[CalibrationResult]:
    truths: references.Truths = {}
    results: dict[str, CalibrationResult] = {}
    by_product: dict[int | None, list[ReducedAttempt]] = {}
    for row in rows:
        by_product.setdefault(row.product, []).append(row)
    for product, own in by_product.items():
        rounding = _rounding(log, product)
        units = {r.attempt: reduced_visits_document.from_document(json.loads(r.stops), recipe, truths) for r in own}
        solved = pipeline.calibrate_reduced(recipe, units, rounding)
        results |= dict(zip(units, solved, strict=True))
    return [results[row.attempt] for row in rows]


def _rounding(log: LogReader, product: int | None) -> Floats:
    if product is None:
        return pipeline.NO_ROUNDING
    return writeback.rounding_std(product_record.load(log.document(product))[0].map)


def _from_frames(log: LogReader, rows: Sequence[ReducedAttempt], recipe: Recipe) -> list[CalibrationResult]:
    found = {a.attempt: a for row in rows for a in log.attempts(Query(serial=row.serial))}
    return [_recompute_attempt(log, found[row.attempt], recipe) for row in rows]


def _recompute_attempt(log: LogReader, attempt: Attempt, recipe: Recipe) -> CalibrationResult:
    old, product, layout = parse_recipe_and_product(*log.recipe_and_product(attempt))
    stored = log.attempt(attempt)
    visits = stored_visits(stored["visits"], log.frames(attempt))
    if backtest.dwells_differ(old, recipe):
        visits = backtest.recut_dwells(visits, old, recipe)
    positions = {p.name for p in recipe.positions}
    at_positions = [v for v in visits if not recipe.pose_known or v.position in positions]
    return refit_attempt(attempt, at_positions, recipe, (product, layout), stored)


def _before(row: ReducedAttempt) -> PreviousResult:
    outcome, offset, matrix, checks = json.loads(row.before)
    theta = None if offset is None else np.array([*offset, *(v for part in matrix for v in part)])
    return PreviousResult(row.attempt, row.serial, outcome, theta, tuple((c["check"], c["sentence"]) for c in checks))
