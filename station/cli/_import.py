"""The work of `station import` and `station segment`: files → recordings → visits → a samples table, and what was
understood of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from station.cli import _output
from station.config.recipes import load_recipe
from station.domain.recipe import references
from station.domain.recipe.recipe import Recipe
from station.domain.recognition import (
    columns,
    compass_beside,
    interleaved,
    next_step,
    samples,
    six_faces,
    still_files,
    understanding,
    unsigned,
    which_quantity,
)
from station.domain.recognition.clock import TIME_UNITS
from station.domain.recognition.quantities import QUANTITIES
from station.domain.recognition.raw_table import ImportOptions, RawTable
from station.domain.recognition.recording import Recording, understand
from station.domain.recognition.samples import UnitRecording, Visits
from station.errors import SamplesError, StationError, UsageError
from station.messages import Message, render
from station.wiring.raw_tables import raw_tables, write_recording
from station.wiring.sample_files import write_samples

if TYPE_CHECKING:
    from rich.progress import Progress

#: Readings a second where neither the file nor a person nor a recipe tells.
ASSUMED_RATE_HZ = 100.0


@dataclass(frozen=True, slots=True)
class ImportJob:
    """options: what is stated of the columns; recipe: unit and positions; runs: files are runs and not units;
    segmenting: rest is found, whatever visits a table of this station has; units: files are units, whatever poses
    they hold."""

    options: ImportOptions
    recipe: str | None
    dbc: Path | None
    serial: str | None
    runs: bool = False
    segmenting: bool = False
    units: bool = False


def import_files(
    files: Sequence[Path], job: ImportJob, out: Path | None, *, raw: bool = False, as_json: bool = False
) -> int:
    """Prints what was understood of the files, and writes it. Errors: InputError."""
    _check(job.options)
    recipe = load_recipe(job.recipe) if job.recipe is not None else None
    with _output.progress() as bar:
        visited = _visited(files, job, recipe, bar, raw=raw)
        if out is not None:
            bar.add_task(render(Message("activity-writing", file=out.name)), total=None)
            _write(visited, out, raw=raw)
    documents = [understanding.document(p, visits) for p, visits in visited]
    if as_json:
        _output.print_json({"schema": understanding.SCHEMA, "recordings": documents})
    else:
        _print(visited, documents, out, job.recipe)
    return 0


def _visited(
    files: Sequence[Path], job: ImportJob, recipe: Recipe | None, bar: "Progress", *, raw: bool
) -> list[tuple[UnitRecording, Visits | None]]:
    """The passes of every file with their visits; raw: without."""
    task = bar.add_task("", total=len(files))
    read: list[list[UnitRecording]] = []
    for run, path in enumerate(files):
        bar.update(task, description=render(Message("activity-reading", file=path.name)))
        read.append(_passes(path, run, job, recipe))
        bar.advance(task)
    one_rest = job.units or (recipe is not None and len(recipe.positions) == 1)
    passes = [one for passes in read for one in passes] if raw or one_rest else _as_units(files, read, job)
    if raw:
        return [(one, None) for one in passes]
    try:
        visited = [(one, samples.visits_of(one.recording, recipe, one_rest=one_rest)) for one in passes]
    except SamplesError as error:
        turned = None if _is_compass(passes) else _compass_beside(error, files, job)
        if turned is None:
            raise
        return [turned]
    return list(visited if recipe is not None else six_faces.called_after_faces(visited))


def _is_compass(passes: Sequence[UnitRecording]) -> bool:
    return all(one.recording.unit == "uT" for one in passes)


def _compass_beside(error: SamplesError, files: Sequence[Path], job: ImportJob) -> tuple[UnitRecording, Visits] | None:
    """The compass of the same file that was turned all round, where nobody asked for another sensor; with what is wrong
    with the one that comes first."""
    if job.recipe is not None or job.options.columns is not None or len(files) != 1:
        return None
    for table in raw_tables(files[0], job.dbc):
        axes = compass_beside.turned_compass(unsigned.signed(table), job.options)
        if not axes:
            continue
        note = Message("compass-beside", reason=error.message, columns=",".join(axes))
        taken = replace(job, options=replace(job.options, columns=axes))
        try:
            (one,) = _passes(files[0], 0, taken, None)
            visits = samples.visits_of(one.recording, None)
        except SamplesError:
            return None
        if one.recording.unit != "uT" or visits.found_by != "readings":
            return None
        return replace(one, recording=replace(one.recording, remarks=(note, *one.recording.remarks))), visits
    return None


def _as_units(files: Sequence[Path], read: Sequence[list[UnitRecording]], job: ImportJob) -> list[UnitRecording]:
    """The passes of the files, those that hold the poses of one unit joined."""
    stated = job.runs or job.segmenting or job.options.labels is not None or job.options.blocks is not None
    if stated or any(len(passes) != 1 for passes in read):
        return [one for passes in read for one in passes]
    named = [(str(f.parent), f.stem) for f in files]
    joined = still_files.units_of_poses(named, [passes[0].recording for passes in read], job.serial)
    if joined is None:
        return [passes[0] for passes in read]
    return [UnitRecording(serial, 0, recording) for serial, recording in joined]


def _write(visited: Sequence[tuple[UnitRecording, Visits | None]], out: Path, *, raw: bool) -> None:
    if raw:
        write_recording([one for one, _ in visited], out)
    else:
        write_samples(samples.samples_table([(p, v) for p, v in visited if v is not None]), out)


def _check(options: ImportOptions) -> None:
    if options.time_unit not in (None, "none", *TIME_UNITS):
        raise UsageError("time-unit-unknown", unit=str(options.time_unit))
    if options.rate_hz is not None and not 0 < options.rate_hz < 1e7:
        raise UsageError("rate-not-positive", rate_hz=options.rate_hz)
    if options.scale is not None and options.scale == 0:
        raise UsageError("scale-is-zero")
    if options.unit is not None and options.scale is not None:
        raise UsageError("unit-and-scale")


def _passes(path: Path, number: int, job: ImportJob, recipe: Recipe | None) -> list[UnitRecording]:
    """The passes of units in a file."""
    found = []
    base = job.serial or path.stem
    for table in _chosen([unsigned.signed(t) for t in raw_tables(path, job.dbc)], job, recipe):
        if samples.is_samples_table(table) and not job.segmenting:
            raise UsageError("samples-table-already", file=str(path))
        written = samples.by_unit_and_run(table)
        sensors = [(f"{base}-{name}", 0, part) for name, part in interleaved.sensors(table)] if len(written) < 2 else []
        for serial, run, part in sensors or written:
            recording = _understood(part, job, recipe)
            found.append(UnitRecording(serial or base, number if job.runs else run, recording))
    return found


def _chosen(tables: list[RawTable], job: ImportJob, recipe: Recipe | None) -> list[RawTable]:
    """Of the tables of one file the one that holds the axes. Errors: of the first where none does."""
    if len(tables) == 1:
        return tables
    ranked: list[tuple[int, int, int]] = []
    quantities = list(QUANTITIES)
    failed: list[StationError] = []
    for i, table in enumerate(tables):
        try:
            unit = _unit(table, job, recipe)
            roles = columns.assign(table, job.options, QUANTITIES[unit])
            ranked.append((roles.rank, quantities.index(unit), i))
        except StationError as error:
            failed.append(error)
    if not ranked:
        raise failed[0]
    return [tables[min(ranked)[-1]]]


def _unit(table: RawTable, job: ImportJob, recipe: Recipe | None) -> str:
    """The unit to scale to: the recipe's; else that of the quantity that the table holds."""
    return recipe.unit if recipe is not None else which_quantity.unit_of(table, job.options)


def _understood(table: RawTable, job: ImportJob, recipe: Recipe | None) -> Recording:
    rate_hz = recipe.device.rate_hz if recipe is not None else ASSUMED_RATE_HZ
    rates = None
    if recipe is not None and recipe.feels_rotation and recipe.pose_known:
        names = tuple(p.name for p in recipe.positions)
        rates = references.true_vectors(recipe, names, ("home",) * len(names))
    return understand(table, job.options, _unit(table, job, recipe), rate_hz, rates)


def _print(
    visited: Sequence[tuple[UnitRecording, Visits | None]],
    documents: Sequence[dict[str, Any]],
    out: Path | None,
    recipe: str | None,
) -> None:
    for (one, visits), document in zip(visited, documents, strict=True):
        remarks = (*one.recording.remarks, *(visits.remarks if visits is not None else ()))
        for message in understanding.messages(document, remarks):
            _output.print_message(message)
    if out is not None:
        found = [(one, v) for one, v in visited if v is not None]
        count = sum(len(v.edges) for _, v in found)
        written = Message("wrote-visits", file=str(out), visits=count) if count else Message("wrote-raw", file=str(out))
        _output.print_message(written)
        if count and (step := next_step.of(found, recipe, str(out))) is not None:
            _output.print_message(step)
