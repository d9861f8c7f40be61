"""The work of `station backtest`."""

from dataclasses import asdict, dataclass
from typing import Any

from station.cli import _output
from station.cli._fleet import FleetRequest, computed, describe_sources, recipes_in_use
from station.cli._layout import TextTable
from station.config.recipes import recipe_hash
from station.domain.evaluation.backtest import BacktestTotals
from station.domain.recipe.recipe import Recipe
from station.messages import Message
from station.ports.log_reader import Query
from station.service import backtest
from station.service.fleet import FleetJob
from station.wiring.fleet import code_version

_MOST_LISTED = 20


@dataclass(frozen=True, slots=True)
class BacktestRequest:
    """What is asked."""

    recipe: Recipe
    query: Query
    from_frames: bool
    fleet: FleetRequest


def run_backtest(request: BacktestRequest, *, as_json: bool) -> int:
    """Prints what would change. Errors: LogError, RecipeError, StoreFault, StationFault."""
    recipe, sources = request.recipe, request.fleet.sources
    used = recipes_in_use(sources, request.query)
    backtest.check(recipe)
    from_frames = request.from_frames or backtest.any_dwells_differ(used, recipe)
    job = FleetJob("backtest", recipe, request.query, code_version(), from_frames)
    with computed(request.fleet, job, backtest.compare_portion, backtest.COLUMNS) as (planned, results):
        compared = backtest.sum_backtest(planned, results)
    document = _document(request, planned.attempts, compared, "frames" if from_frames else "stops")
    if as_json:
        _output.print_json(document)
    else:
        _show(document)
    return 0


def _document(request: BacktestRequest, attempts: int, compared: BacktestTotals, computed_from: str) -> dict[str, Any]:
    done, sources = compared.verdicts.total(), describe_sources(request.fleet.sources)
    return {
        "schema": "station.backtest/1",
        "log": sources[0]["location"],
        "head": sources[0]["head"],
        "sources": sources,
        "recipe": {"name": request.recipe.name, "version": request.recipe.version, "hash": recipe_hash(request.recipe)},
        "of": request.query.recipe_name,
        "computed_from": computed_from,
        "attempts": attempts,
        "compared": done,
        "without_calibration": attempts - done,
        "simulated": compared.simulated,
        "judged_with_history": compared.taught,
        "verdicts": [{"before": b, "after": a, "count": n} for (b, a), n in sorted(compared.verdicts.items())],
        "changed": [asdict(change) for change in compared.changes],
        "coefficients": compared.summary(request.recipe.unit),
    }


def _show(d: dict[str, Any]) -> None:
    name = f"{d['recipe']['name']} version {d['recipe']['version']}"
    _output.print_line(
        f"{d['compared']} of {d['attempts']} attempts with recipe {d['of']}, computed again under {name}"
    )
    source = "raw frames" if d["computed_from"] == "frames" else "reduced visits"
    _output.print_line(f"from {source}; {d['without_calibration']} never came to a calibration")
    if d["judged_with_history"]:
        _output.print_message(Message("backtest-history", count=d["judged_with_history"]))
    if d["simulated"]:
        _output.print_message(Message("attempts-simulated", count=d["simulated"]))
    for row in d["verdicts"]:
        same = "stay" if row["before"] == row["after"] else "become"
        _output.print_line(f"  {row['count']:>8}  {row['before']} {same} {row['after']}")
    for change in d["changed"][:_MOST_LISTED]:
        why = "; ".join(change["reasons"]) or "nothing speaks against it any more"
        _output.print_line(f"  {change['serial']}: {change['before']} becomes {change['after']}: {why}")
    if len(d["changed"]) > _MOST_LISTED:
        _output.print_line(f"  and {len(d['changed']) - _MOST_LISTED} more; --json lists them all")
    heads = ("coefficient", "rms change", "largest", "in its uncertainty")
    rows = [
        (c["name"], f"{c['rms_change']:.3g}", f"{c['max_change']:.3g}", f"{c['max_change_in_std']:.3g}")
        for c in d["coefficients"]
    ]
    _output.print_table("", TextTable(heads, rows, right=frozenset({1, 2, 3}), indent=2))
