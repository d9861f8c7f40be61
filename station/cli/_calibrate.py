"""The work of `station calibrate`: read, compute portion by portion, tell people and programs."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import chain
from math import isnan
from pathlib import Path
from typing import Any

from station.cli import _calibrate_table, _output
from station.cli._calibrate_json import CalibrationJsonWriter
from station.cli._calibrate_table import CalibrationSummary
from station.config.products import load_product
from station.config.recipes import load_recipe, recipe_path
from station.diagnosis.data import input_checks, preflight, stays
from station.diagnosis.data.family import Family
from station.diagnosis.data.preflight import Preflight
from station.domain.core.types import Floats, Outcome, SampleTable
from station.domain.evaluation import calibration_document, model_comparison, pipeline
from station.domain.evaluation.model_comparison import LargerModel
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.product import writeback
from station.domain.recipe.recipe import Recipe
from station.domain.records.stored_attempt import utc_day
from station.errors import InputError, SamplesError, UsageError, naming_file
from station.messages import system_reason
from station.wiring.process_memory import retain_all_memory
from station.wiring.sample_files import by_units


@dataclass(frozen=True, slots=True)
class CalibrateOutputs:
    """What is to be told: where the JSON document goes, a folder for pictures, and what else is printed."""

    json: Path | None
    pictures: Path | None
    budget: bool = False
    compare_models: bool = False


def calibrate_file(samples: Path, recipe_name: str, wanted: CalibrateOutputs) -> int:
    """Calibrates every unit of a file; returns the exit code. Errors: InputError, ReferenceOverdue."""
    retain_all_memory()
    with naming_file(samples):
        return _calibrate_file(samples, recipe_name, wanted)


def _calibrate_file(samples: Path, recipe_name: str, wanted: CalibrateOutputs) -> int:
    recipe = load_recipe(recipe_name)
    summary = CalibrationSummary()
    with CalibrationJsonWriter(wanted.json, calibration_document.head(recipe)) as file:
        checked: list[Preflight] = []
        family = Family()
        for result in _calibrate(recipe, samples, _rounding(recipe, recipe_path(recipe_name)), checked):
            family.add(result)
            larger = model_comparison.of_unit(recipe, result) if wanted.compare_models else ()
            summary.add(result, larger)
            file.add(_unit(result, larger))
            if wanted.pictures is not None:
                _draw(wanted.pictures, recipe, result)
        if summary.calibrated == 0:
            raise SamplesError(summary.first[0].verdict.reasons[0].message)
        found = replace(preflight.merge(checked), remarks=(*preflight.merge(checked).remarks, *family.outlying()))
        file.append("preflight", found.document())
        file.append("simulated", found.simulated > 0)
    if str(wanted.json) != "-":
        for line in preflight.lines(found, recipe.unit):
            _output.print_message(line)
        _calibrate_table.print_calibrations(recipe, summary, with_budget=wanted.budget, compared=wanted.compare_models)
    for sentence in summary.refused:
        _output.print_remark(f"station: {samples}: {sentence}")
    return _exit_code(summary)


def _exit_code(summary: CalibrationSummary) -> int:
    if summary.outcomes[Outcome.ERROR]:
        return InputError.exit_code
    return 1 if summary.outcomes[Outcome.FAIL] else 0


def _unit(result: CalibrationResult, larger: Sequence[LargerModel]) -> dict[str, Any]:
    found = calibration_document.unit(result)
    if larger:
        # JSON knows no NaN: what cannot be fitted is null.
        rows = [asdict(one) for one in larger]
        found["larger_models"] = [
            {k: None if isinstance(v, float) and isnan(v) else v for k, v in row.items()} for row in rows
        ]
    return found


def _calibrate(
    recipe: Recipe, samples: Path, rounding: Floats, checked: list[Preflight]
) -> Iterator[CalibrationResult]:
    """Every unit; fills `checked` with what the preflight found of each portion of the table."""
    today = utc_day(time.time_ns())
    with _output.progress() as bar:
        task = bar.add_task("calibrating", total=None)
        tables = _inspected(recipe, samples, checked)
        first = next(tables)
        results = pipeline.calibrate_portions(
            preflight.with_sheet(recipe, checked[0]), chain([first], tables), today, rounding
        )
        for done, result in enumerate(results, start=1):
            if not recipe.pose_known:
                input_checks.check_fit(result)
            bar.update(task, description=f"calibrated {done} units")
            yield result


def _inspected(recipe: Recipe, samples: Path, checked: list[Preflight]) -> Iterator[SampleTable]:
    """The portions of a table without the visits that the preflight leaves out, pieces of one rest joined."""
    for table in by_units(samples):
        found, cleaned = preflight.inspect(recipe, table)
        checked.append(found)
        yield stays.whole_rests(recipe, cleaned)


def _rounding(recipe: Recipe, path: Path) -> Floats:
    """Standard deviations (12) of the coefficients' rounding in the product's own format; 0 without a product."""
    if recipe.product is None:
        return pipeline.NO_ROUNDING
    return writeback.rounding_std(load_product(recipe.product, path).map)


def _draw(folder: Path, recipe: Recipe, result: CalibrationResult) -> None:
    from station.cli._calibrate_figures import unit_figures

    safe = "".join(c if c.isalnum() or c in "-_." else "_" for c in result.serial)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, svg in unit_figures(recipe, result).items():
            (folder / f"{safe}-{name}.svg").write_text(svg, encoding="utf-8")
    except OSError as exc:
        raise UsageError("option-not-written", option="--pictures", path=str(folder), why=system_reason(exc)) from exc
