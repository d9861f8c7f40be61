"""The work of `station backtest`."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from station.cli import _output
from station.config.recipes import recipe_hash
from station.domain.evaluation import backtest
from station.domain.evaluation.backtest import BacktestResult
from station.domain.recipe.recipe import Recipe
from station.errors import LogError
from station.ports.log_reader import Attempt, LogReader, Query
from station.service.backtest import run
from station.service.recompute import parse_recipe_and_product
from station.wiring.logs import open_log

_MOST_LISTED = 20


@dataclass(frozen=True, slots=True)
class BacktestRequest:
    """What is asked."""

    recipe: Recipe
    query: Query
    from_frames: bool
    processes: int | None


def run_backtest(log: LogReader, request: BacktestRequest, *, as_json: bool) -> int:
    """Prints what would change. Errors: LogError, RecipeError."""
    attempts = log.attempts(request.query)
    if not attempts:
        raise LogError("backtest-no-attempts", log=log.location, recipe=str(request.query.recipe_name))
    from_frames = request.from_frames or _windows_differ(log, attempts, request.recipe)
    with _output.progress() as bar:
        task = bar.add_task("computing again", total=len(attempts))
        compared = run(
            partial(open_log, Path(log.location)),
            attempts,
            request.recipe,
            from_frames=from_frames,
            processes=request.processes,
            progress=lambda done: bar.advance(task, done),
        )
    document = _document(log, request, attempts, compared, "frames" if from_frames else "stops")
    if as_json:
        _output.print_json(document)
    else:
        _show(document)
    return 0


def _windows_differ(log: LogReader, attempts: Sequence[Attempt], changed: Recipe) -> bool:
    """Whether any of the recipes in use then cut its dwells otherwise."""
    one_of_each = {a.recipe_hash: a for a in attempts}.values()
    used = (parse_recipe_and_product(*log.recipe_and_product(a))[0] for a in one_of_each)
    return any(backtest.dwells_differ(old, changed) for old in used)


def _document(
    log: LogReader, request: BacktestRequest, attempts: Sequence[Attempt], compared: BacktestResult, computed_from: str
) -> dict[str, Any]:
    done = compared.verdicts.total()
    return {
        "schema": "station.backtest/1",
        "log": log.location,
        "head": asdict(log.head()),
        "recipe": {"name": request.recipe.name, "version": request.recipe.version, "hash": recipe_hash(request.recipe)},
        "of": request.query.recipe_name,
        "computed_from": computed_from,
        "attempts": len(attempts),
        "compared": done,
        "without_calibration": len(attempts) - done,
        "verdicts": [{"before": b, "after": a, "count": n} for (b, a), n in sorted(compared.verdicts.items())],
        "changed": [asdict(change) for change in compared.changes],
        "coefficients": backtest.summary(compared, request.recipe),
    }


def _show(d: dict[str, Any]) -> None:
    name = f"{d['recipe']['name']} version {d['recipe']['version']}"
    _output.print_line(
        f"{d['compared']} of {d['attempts']} attempts with recipe {d['of']}, computed again under {name}"
    )
    source = "raw frames" if d["computed_from"] == "frames" else "reduced visits"
    _output.print_line(f"from {source}; {d['without_calibration']} never came to a calibration")
    for row in d["verdicts"]:
        same = "stay" if row["before"] == row["after"] else "become"
        _output.print_line(f"  {row['count']:>8}  {row['before']} {same} {row['after']}")
    for change in d["changed"][:_MOST_LISTED]:
        why = "; ".join(change["reasons"]) or "nothing speaks against it any more"
        _output.print_line(f"  {change['serial']}: {change['before']} becomes {change['after']}: {why}")
    if len(d["changed"]) > _MOST_LISTED:
        _output.print_line(f"  … and {len(d['changed']) - _MOST_LISTED} more; --json lists them all")
    _output.print_line("  coefficient              rms change   largest   in its uncertainty")
    for c in d["coefficients"]:
        _output.print_line(
            f"  {c['name']:<22} {c['rms_change']:>12.3g} {c['max_change']:>9.3g} {c['max_change_in_std']:>12.3g}"
        )
