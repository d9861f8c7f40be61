"""The work of `station simulate`: a campaign into a samples file or a CAN log, and its truth beside it."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from station.cli import _output
from station.config.models import load_model
from station.config.recipes import load_recipe, recipe_path
from station.config.settings import load_settings
from station.domain.records.stored_attempt import MARK
from station.errors import UsageError
from station.messages import system_reason
from station.model import truth
from station.model.simulate import SimulatedUnits, SimulationJob, parse_effects, simulate_in_parts
from station.model.simulated_line import SimulatedLine

if TYPE_CHECKING:
    from station.domain.can.sensor_layout import SensorLayout

TABLE_ENDINGS, LOG_ENDINGS = (".parquet", ".csv"), (".log", ".blf")


@dataclass(frozen=True, slots=True)
class SimulateRequest:
    """What the command line asks for; recipe and product by name or path."""

    recipe: str | None
    units: int
    seed: int
    model: Path | None
    effects: tuple[str, ...]
    product: str | None
    line: SimulatedLine
    gold: bool


def run_simulate(out: Path, request: SimulateRequest, *, as_json: bool) -> int:
    """Writes the campaign and its truth; returns the exit code. Errors: InputError."""
    ending = out.suffix.lower()
    if ending not in (*TABLE_ENDINGS, *LOG_ENDINGS):
        raise UsageError("option-ending", option="--out", path=str(out), endings=(*TABLE_ENDINGS, *LOG_ENDINGS))
    if not out.parent.is_dir():
        raise UsageError("option-no-folder", option="--out", path=str(out), folder=str(out.parent))
    name = request.recipe or load_settings().recipe
    job = _job(request, name)
    try:
        truth = _write_table(out, job) if ending in TABLE_ENDINGS else _write_log(out, job, name, request.product)
        truth_path = out.with_suffix(".truth.json")
        truth_path.write_text(json.dumps(truth, ensure_ascii=False, allow_nan=False, indent=1), encoding="utf-8")
    except OSError as exc:
        raise UsageError("option-not-written", option="--out", path=str(out), why=system_reason(exc)) from None
    _print_summary(out, truth_path, truth, as_json=as_json)
    return 0


def _job(request: SimulateRequest, name: str) -> SimulationJob:
    recipe = load_recipe(name)
    model = load_model(request.model, recipe.unit)
    return SimulationJob(
        recipe=recipe,
        units=tuple(f"SN{i + 1:04d}" for i in range(request.units)),
        seed=request.seed,
        effects=parse_effects(request.effects, recipe),
        model=model,
        line=request.line,
        gold=request.gold,
    )


def _write_table(out: Path, job: SimulationJob) -> dict[str, Any]:
    """Samples, some units at a time."""
    from station.wiring.sample_files import write_parts

    known = truth.Truth(job)

    def tables() -> Iterator[Any]:
        with _output.progress() as bar:
            task = bar.add_task("simulating", total=len(job.units))
            for part in simulate_in_parts(job):
                known.add(SimulatedUnits(part.units, part.base, part.active, part.scene.without_rows()))
                yield part.table.labelled({"simulated": MARK})
                bar.advance(task, len(part.units))

    write_parts(tables(), out)
    return known.document()


def _write_log(out: Path, job: SimulationJob, name: str, product: str | None) -> dict[str, Any]:
    """CAN frames, and their marks."""
    from station.model.frame_recording import simulate_frames
    from station.wiring.recordings import write_log, write_marks

    recorded = simulate_frames(job, _layout(job, name, product))
    write_log(out, recorded.frames, MARK)
    marks = tuple(mark.model_copy(update={"simulated": MARK}) for mark in recorded.marks.marks)
    write_marks(out.with_name(f"{out.name}.marks.csv"), recorded.marks.model_copy(update={"marks": marks}))
    return truth.document(job, [recorded.made])


def _layout(job: SimulationJob, name: str, product: str | None) -> "SensorLayout":
    """The frames of the product."""
    from station.config.products import load_product, product_path
    from station.domain.can.sensor_layout import resolve, used_signals
    from station.wiring.product_files import read_layouts

    product_name, near = product or job.recipe.product, recipe_path(name)
    if product_name is None:
        raise UsageError("simulate-without-product", file=str(near))
    frames = load_product(product_name, near).frames
    return resolve(frames, read_layouts(product_path(product_name, near).parent / frames.dbc, used_signals(frames)))


def _print_summary(out: Path, truth_path: Path, truth: dict[str, Any], *, as_json: bool) -> None:
    names = [effect["effect"] for effect in truth["effects"]]
    if as_json:
        document = {"schema": "station.simulation/1", "out": str(out), "truth": str(truth_path), "effects": names}
        _output.print_json({**document, "units": len(truth["units"]), "seed": truth["seed"]})
        return
    causes = ", ".join(names) or "no cause"
    units = "1 unit" if len(truth["units"]) == 1 else f"{len(truth['units'])} units"
    _output.print_line(f"{units} with {causes}, seed {truth['seed']}: {out}; the truth: {truth_path}")
