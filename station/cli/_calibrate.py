"""The work of `station calibrate`: read, compute portion by portion, tell people and programs."""

import os
from collections.abc import Sequence
from datetime import date
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from station.adapters.samples import by_units
from station.cli import _budget_table, _face
from station.config.products import load_product
from station.config.recipes import load_recipe, recipe_path
from station.domain import document, pipeline, writeback
from station.domain.pipeline import Result
from station.domain.recipe import Recipe
from station.domain.types import Floats, Outcome
from station.errors import InputError, SamplesError, UsageError

if TYPE_CHECKING:
    from rich.table import Table

#: Units whose details are printed; all of them stand in the JSON document.
SHOWN = 20


def calibrate_file(
    samples: Path, recipe_name: str, json: Path | None, pictures: Path | None, *, with_budget: bool
) -> int:
    """Calibrates every unit of a file; returns the exit code. Errors: InputError, ReferenceOverdue."""
    recipe = load_recipe(recipe_name)
    results = _calibrate(recipe, samples, _rounding(recipe, recipe_path(recipe_name)))
    if all(r.calibration is None for r in results):
        raise SamplesError(f"{samples}: {results[0].verdict.reasons[0].sentence}")
    if json is not None:
        _write(json, document.calibration(recipe, results))
    if pictures is not None:
        _draw(pictures, recipe, results)
    if json is None or str(json) != "-":
        _print(recipe, results, with_budget=with_budget)
    for r in results:
        if r.verdict.outcome is Outcome.ERROR:
            _face.remark(f"station: {samples}: {r.verdict.reasons[0].sentence}")
    return _exit_code(results)


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


def _print(recipe: Recipe, results: Sequence[Result], *, with_budget: bool) -> None:
    console = _face.console()
    console.print(_table(recipe, results[:SHOWN]), width=None if console.is_terminal else 110)
    if len(results) > SHOWN:
        console.print(f"… and {len(results) - SHOWN} more units; --json FILE holds them all")
    for r in results[:SHOWN]:
        for line in (*(reason.sentence for reason in r.verdict.reasons), *_notes(r)):
            console.print(f"{r.serial}: {line}", markup=False)
        if with_budget and r.budget is not None:
            title = f"{r.serial}: standard uncertainty by cause"
            console.print(_budget_table.table(r.budget, recipe.unit, title), width=None if console.is_terminal else 130)
    console.print(_summary(recipe, results), markup=False)


def _table(recipe: Recipe, results: Sequence[Result]) -> "Table":
    """Three rows a unit: x, y, z."""
    from rich.table import Table

    shown = Table(title=f"{recipe.name} version {recipe.version}, {recipe.method}", title_justify="left")
    for title in ("serial", "verdict", "axis"):
        shown.add_column(title)
    for title in (f"offset, {recipe.unit}", "± 95 %", "gain", "± 95 %", f"residual, {recipe.unit}", "worst tilt, deg"):
        shown.add_column(title, justify="right")
    for r in results:
        for i, axis in enumerate("xyz"):
            head = (r.serial, str(r.verdict.outcome)) if i == 0 else ("", "")
            shown.add_row(*head, axis, *_cells(r, i), end_section=i == 2)
    return shown


def _cells(r: Result, i: int) -> tuple[str, ...]:
    found = r.calibration
    if found is None or r.budget is None:
        return ("",) * 6
    wide = 1.96 * r.budget.std()
    gain = 3 + 4 * i
    worst = int(np.argmax(np.where(found.disturbed, -1.0, found.tilt_deg)))
    tilt = f"{found.tilt_deg[worst]:.3f} ± {1.96 * found.tilt_std_deg[worst]:.3f}"
    last = (f"{found.residual_rms:.2g} rms", tilt) if i == 0 else ("", f"at {found.positions[worst]}" if i == 1 else "")
    return (f"{found.offset[i]:+.6f}", f"{wide[i]:.2g}", f"{found.matrix[i, i]:.6f}", f"{wide[gain]:.2g}", *last)


def _notes(r: Result) -> tuple[str, ...]:
    return () if r.calibration is None else r.calibration.notes


def _summary(recipe: Recipe, results: Sequence[Result]) -> str:
    passed = [r.verdict for r in results if r.verdict.outcome is Outcome.PASS]
    told = f"{len(passed)} of {len(results)} units pass"
    limits = recipe.limits
    if all(v is None for v in (limits.offset, limits.gain, limits.cross_axis)):
        return f"{told}; the recipe has no limits for coefficients"
    if passed:
        worst = max(v.false_accept for v in passed)
        chance = "below 1e-6" if worst < 1e-6 else f"at most {worst:.2g}"
        told += f"; probability of a false accept {chance}; rule {passed[0].rule}"
    return told
