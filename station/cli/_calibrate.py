"""The work of `station calibrate`: read, compute portion by portion, tell people and programs."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import date
from json import dumps
from math import isnan
from pathlib import Path
from typing import Any

from station.adapters.samples import by_units
from station.cli import _calibrate_table, _face
from station.config.products import load_product
from station.config.recipes import load_recipe, recipe_path
from station.domain import document, larger_model, pipeline, writeback
from station.domain.larger_model import Larger
from station.domain.pipeline import Result
from station.domain.recipe import Recipe
from station.domain.types import Floats, Outcome
from station.errors import InputError, SamplesError, UsageError


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is to be told: where the JSON document goes, a folder for pictures, and what else is printed."""

    json: Path | None
    pictures: Path | None
    budget: bool = False
    compare_models: bool = False


def calibrate_file(samples: Path, recipe_name: str, wanted: Wanted) -> int:
    """Calibrates every unit of a file; returns the exit code. Errors: InputError, ReferenceOverdue."""
    recipe = load_recipe(recipe_name)
    results = _calibrate(recipe, samples, _rounding(recipe, recipe_path(recipe_name)))
    if all(r.calibration is None for r in results):
        raise SamplesError(f"{samples}: {results[0].verdict.reasons[0].sentence}")
    larger = {r.serial: larger_model.of_unit(recipe, r) for r in results} if wanted.compare_models else {}
    if wanted.json is not None:
        _write(wanted.json, _document(recipe, results, larger))
    if wanted.pictures is not None:
        _draw(wanted.pictures, recipe, results)
    if str(wanted.json) != "-":
        _calibrate_table.show(recipe, results, with_budget=wanted.budget)
        _calibrate_table.show_larger(recipe, larger)
    for r in results:
        if r.verdict.outcome is Outcome.ERROR:
            _face.remark(f"station: {samples}: {r.verdict.reasons[0].sentence}")
    return _exit_code(results)


def _document(recipe: Recipe, results: Sequence[Result], larger: Mapping[str, Sequence[Larger]]) -> dict[str, Any]:
    found = document.calibration(recipe, results)
    for unit in found["units"] if larger else ():
        # JSON knows no NaN: what cannot be fitted is null.
        rows = [
            {k: None if isinstance(v, float) and isnan(v) else v for k, v in asdict(one).items()}
            for one in larger[unit["serial"]]
        ]
        unit["larger_models"] = rows
    return found


def _exit_code(results: Sequence[Result]) -> int:
    outcomes = {r.verdict.outcome for r in results}
    if Outcome.ERROR in outcomes:
        return InputError.exit_code
    return 0 if outcomes == {Outcome.PASS} else 1


def _calibrate(recipe: Recipe, samples: Path, rounding: Floats) -> list[Result]:
    today = date.today().isoformat()  # noqa: DTZ011 - a due date is a day on the wall
    found: list[Result] = []
    with _face.progress() as bar:
        task = bar.add_task("calibrating", total=None)
        for table in by_units(samples):
            for result in pipeline.calibrate(recipe, table, today, rounding):
                found.append(result)
                bar.update(task, description=f"calibrated {len(found)} units")
    return found


def _rounding(recipe: Recipe, path: Path) -> Floats:
    """Standard deviations (12) of the coefficients' rounding in the product's own format; 0 without a product."""
    if recipe.product is None:
        return pipeline.NO_ROUNDING
    return writeback.rounding_std(load_product(recipe.product, path).map)


def _write(path: Path, found: object) -> None:
    if str(path) == "-":
        _face.say_json(found)
        return
    part = path.with_name(f"{path.name}.part")
    try:
        part.write_text(dumps(found, allow_nan=False, ensure_ascii=False), encoding="utf-8")
        os.replace(part, path)  # noqa: PTH105 - one name, whole or not at all
    except OSError as exc:
        raise UsageError(
            f"--json {path} cannot be written ({exc.strerror}); name a file in a folder that exists"
        ) from exc


def _draw(folder: Path, recipe: Recipe, results: Sequence[Result]) -> None:
    from station.cli._pictures import of_unit

    try:
        folder.mkdir(parents=True, exist_ok=True)
        for result in results:
            for name, svg in of_unit(recipe, result).items():
                safe = "".join(c if c.isalnum() or c in "-_." else "_" for c in result.serial)
                (folder / f"{safe}-{name}.svg").write_text(svg, encoding="utf-8")
    except OSError as exc:
        raise UsageError(f"--pictures {folder} cannot be written ({exc.strerror}); name another folder") from exc
