"""Stored units solved again from their reduced visits or their raw frames, each by what the log had taught it:
what the jobs over a fleet share."""

import json
from collections.abc import Sequence

from station.domain.core.types import Floats
from station.domain.evaluation import backtest, pipeline, reduced_visits_texts
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.line_quality import history
from station.domain.product import product_record, writeback
from station.domain.recipe import references
from station.domain.recipe.recipe import Recipe
from station.errors import LogError
from station.ports.fleet import UnitSource
from station.ports.log_reader import Attempt, LogReader, Query, ReducedAttempt
from station.service.fleet import FleetWork
from station.service.recompute import parse_recipe_and_product, refit_attempt, stored_visits


def solve_again(work: FleetWork) -> tuple[list[ReducedAttempt], list[CalibrationResult]]:
    """The stored attempts of a portion, and what each comes to under the job's recipe. Errors: LogError."""
    recipe = Recipe.model_validate_json(work.recipe)
    with work.open_source() as source:
        rows = source.reduced(work.numbers)
        return rows, _from_frames(source, rows, recipe) if work.from_frames else _from_reduced(source, rows, recipe)


def _from_reduced(source: UnitSource, rows: Sequence[ReducedAttempt], recipe: Recipe) -> list[CalibrationResult]:
    truths: references.Truths = {}
    results: dict[int, CalibrationResult] = {}
    same: dict[tuple[int | None, str], list[ReducedAttempt]] = {}
    for row in rows:
        same.setdefault((row.product, row.history), []).append(row)
    for (product, taught), own in same.items():
        rounding = _rounding(source, product)
        known = history.of_document(json.loads(taught) if taught else None)
        visits = reduced_visits_texts.from_texts([r.stops for r in own], recipe, truths)
        units = dict(zip([r.attempt for r in own], visits, strict=True))
        solved = pipeline.calibrate_reduced(known.applied(recipe), units, rounding)
        results |= {row.number: result for row, result in zip(own, solved, strict=True)}
    return [results[row.number] for row in rows]


def _rounding(source: UnitSource, product: int | None) -> Floats:
    if product is None:
        return pipeline.NO_ROUNDING
    return writeback.rounding_std(product_record.load(source.document(product))[0].map)


def _from_frames(source: UnitSource, rows: Sequence[ReducedAttempt], recipe: Recipe) -> list[CalibrationResult]:
    if not isinstance(source, LogReader):
        raise LogError("fleet-tables-without-frames", folder=source.location)
    found = {a.attempt: a for row in rows for a in source.attempts(Query(serial=row.serial))}
    return [_recompute_attempt(source, found[row.attempt], recipe) for row in rows]


def _recompute_attempt(log: LogReader, attempt: Attempt, recipe: Recipe) -> CalibrationResult:
    old, product, layout = parse_recipe_and_product(*log.recipe_and_product(attempt))
    stored = log.attempt(attempt)
    visits = stored_visits(stored["visits"], log.frames(attempt))
    if backtest.dwells_differ(old, recipe):
        visits = backtest.recut_dwells(visits, old, recipe)
    positions = {p.name for p in recipe.positions}
    at_positions = [v for v in visits if not recipe.pose_known or v.position in positions]
    return refit_attempt(attempt, at_positions, recipe, (product, layout), stored)
