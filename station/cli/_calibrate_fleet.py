"""The work of `station calibrate --db`: a fleet's stored units, in portions."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from station.cli import _output
from station.cli._fleet import FleetRequest, computed, describe_sources, recipes_in_use
from station.cli._layout import TextTable
from station.config.recipes import load_recipe, recipe_hash
from station.domain.core.types import Outcome
from station.domain.planning import design
from station.errors import InputError, UsageError
from station.files.replace import check_replaceable, replace_text
from station.messages import Message, system_reason
from station.ports.log_reader import Query
from station.service import fleet_calibration
from station.service.fleet import FleetJob
from station.wiring.fleet import code_version

_EXIT_CODES = {Outcome.ERROR: InputError.exit_code, Outcome.FAIL: 1, Outcome.PASS: 0}


def calibrate_fleet(recipe_name: str, of: str | None, fleet: FleetRequest, json_path: Path | None) -> int:
    """Calibrates and tells; the exit code. of: the name of the recipe that they were made with.

    Errors: InputError, StoreFault, StationFault."""
    check_document_place(json_path)
    recipe = load_recipe(recipe_name)
    design.check(recipe)
    query = Query(recipe_name=of or recipe.name)
    recipes_in_use(fleet.sources, query)
    job = FleetJob("calibrate", recipe, query, code_version())
    with computed(fleet, job, fleet_calibration.calibrate_portion, fleet_calibration.COLUMNS) as (planned, results):
        found = fleet_calibration.sum_calibrations(planned, results)
    document: dict[str, Any] = {
        "schema": "station.fleet-calibration/1",
        "sources": describe_sources(fleet.sources),
        "recipe": {"name": recipe.name, "version": recipe.version, "hash": recipe_hash(recipe)},
        "attempts": planned.attempts,
        "simulated": found.simulated,
        "outcomes": dict(sorted(found.outcomes.items())),
        "coefficients": found.summary(recipe.unit),
    }
    write_document(json_path, document)
    if str(json_path) != "-":
        _show(document)
    return _EXIT_CODES[Outcome(found.exit_outcome())]


def check_document_place(path: Path | None) -> None:
    """Before a fleet is computed: whether its document can be written there. Errors: UsageError."""
    if path is not None and str(path) != "-":
        with _refusal_of(path):
            check_replaceable(path)


def write_document(path: Path | None, document: dict[str, Any]) -> None:
    """To a file, or to standard output for -. Errors: UsageError."""
    if path is None:
        return
    if str(path) == "-":
        _output.print_json(document)
        return
    with _refusal_of(path):
        replace_text(path, json.dumps(document, ensure_ascii=False))


@contextmanager
def _refusal_of(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as exc:
        raise UsageError("option-not-written", option="--json", path=str(path), why=system_reason(exc)) from exc


def _show(d: dict[str, Any]) -> None:
    counts = ", ".join(f"{count} {outcome}" for outcome, count in d["outcomes"].items()) or "none calibrated"
    if d["simulated"]:
        _output.print_message(Message("attempts-simulated", count=d["simulated"]))
    _output.print_line(f"{d['attempts']} attempts with recipe {d['recipe']['name']}: {counts}")
    heads = ("coefficient", "mean", "spread", "uncertainty", "unit")
    rows = [
        (c["name"], f"{c['mean']:.5f}", f"{c['spread']:.2g}", f"{c['std']:.2g}", c["unit"]) for c in d["coefficients"]
    ]
    _output.print_table("", TextTable(heads, rows, right=frozenset({1, 2, 3}), indent=2))
