"""Every stored unit computed again under another recipe: one job over a fleet."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic_core import from_json

from station.domain.evaluation import backtest
from station.domain.evaluation.backtest import BacktestTotals, ComparedAttempts, PreviousResult
from station.domain.methods import coefficients
from station.domain.planning import design
from station.domain.recipe.recipe import Recipe
from station.errors import LogError
from station.ports.fleet import Columns, ColumnType, PortionResults
from station.ports.log_reader import ReducedAttempt
from station.service.fleet import FleetPlan, FleetWork
from station.service.reduced_units import solve_again

_TEXTS = ("attempt", "serial", "before", "after")
_FLAGS = ("simulated", "taught")
_MOVES = tuple((f"moved {name}", f"in std {name}") for name in coefficients.NAMES)
#: Columns of a portion's result, one row an attempt.
COLUMNS: Mapping[str, ColumnType] = {
    **dict.fromkeys(_TEXTS, "text"),
    "reasons": "texts",
    **dict.fromkeys(_FLAGS, "integer"),
    **dict.fromkeys((name for pair in _MOVES for name in pair), "number"),
}


def check(recipe: Recipe) -> None:
    """RecipeError when the recipe cannot be computed at all."""
    design.check(recipe)


def any_dwells_differ(used: list[str], changed: Recipe) -> bool:
    """Whether any of the recipes in use (JSON) cut its dwells otherwise. Errors: LogError where one was not kept."""
    if not all(used):
        raise LogError("attempt-without-recipe")
    return any(backtest.dwells_differ(Recipe.model_validate_json(text), changed) for text in used)


def compare_portion(work: FleetWork) -> Columns:
    """One portion, in whatever process: one row an attempt."""
    rows, results = solve_again(work)
    return to_columns(backtest.compare([_before(row) for row in rows], results, from_samples=work.from_frames))


def sum_backtest(planned: FleetPlan, results: PortionResults) -> BacktestTotals:
    """What all portions come to. Errors: StoreFault."""
    found = BacktestTotals()
    for portion in planned.portions:
        found.add(from_columns(results.read(portion.key)))
    return found


def to_columns(part: ComparedAttempts) -> Columns:
    """As it is kept in a table."""
    columns: dict[str, Sequence[Any]] = {name: getattr(part, name) for name in (*_TEXTS, "reasons")}
    columns |= {name: [int(flag) for flag in getattr(part, name)] for name in _FLAGS}
    for (moved, in_std), shift, share in zip(_MOVES, part.moved.T, part.shift_in_std.T, strict=True):
        columns |= {moved: shift.tolist(), in_std: share.tolist()}
    return columns


def from_columns(columns: Columns) -> ComparedAttempts:
    """Out of the table, bit for bit."""
    attempt, serial, before, after = (tuple(map(str, columns[name])) for name in _TEXTS)
    reasons = tuple(tuple(one) for one in columns["reasons"])
    moved, in_std = (np.array([columns[name] for name in names], float).T for names in zip(*_MOVES, strict=True))
    simulated, taught = (tuple(map(bool, columns[name])) for name in _FLAGS)
    return ComparedAttempts(attempt, serial, before, after, reasons, moved, in_std, simulated, taught)


def _before(row: ReducedAttempt) -> PreviousResult:
    outcome, offset, matrix, checks = from_json(row.before)
    theta = None if offset is None else np.array([*offset, *(v for part in matrix for v in part)])
    found = tuple((c["check"], c["sentence"]) for c in checks)
    return PreviousResult(row.attempt, row.serial, outcome, theta, found, row.simulated, bool(row.history))
