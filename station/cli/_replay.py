"""The face of a replay: marks and recipe in, a table or JSON out; or a log decoded signal by signal."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from station.cli import _output
from station.cli._results import Row, print_results, unit_document
from station.config.settings import load_settings
from station.domain.can.signals import FrameLayout, decode
from station.domain.capture import position_matching
from station.domain.capture.annotations import Annotations
from station.domain.core.types import ERROR, Frames, Outcome
from station.errors import LogError, UsageError
from station.messages import Message, system_reason
from station.service.replay import ReplayedUnit, replay
from station.service.station import Job
from station.wiring.jobs import load_job
from station.wiring.product_files import read_layouts
from station.wiring.recordings import find_marks_file, read_log, read_marks


def replay_log(log: Path, recipe: str | None, marks: Path | None, *, as_json: bool) -> int:
    """Calibrates every unit of a log; the exit code."""
    with _output.activity(Message("activity-reading", file=str(log))):
        job, frames, marked = open_recording(log, recipe, marks)
        units = list(replay(frames, marked, job))
    simulated = any(mark.simulated for mark in marked.marks)
    if as_json:
        _output.print_json(_document(units, job) | {"simulated": simulated})
    else:
        print_results([_row(u) for u in units], job.recipe)
        _output.print_line(f"{len(frames)} frames of {log}; nothing was written to a device")
        if simulated:
            _output.print_message(Message("simulated-units"))
    outcomes = {u.outcome for u in units}
    return 3 if Outcome.ERROR in outcomes else 1 if Outcome.FAIL in outcomes else 0


def open_recording(log: Path, recipe: str | None, marks: Path | None) -> tuple[Job, Frames, Annotations]:
    """A log with its recipe and its marks: those given, those beside it, or those found in the frames themselves."""
    given = marks or find_marks_file(log)
    marked = _checked_marks(given, recipe) if given is not None else None
    name = recipe or next(iter(marked.recipes() if marked else ()), None) or load_settings().recipe
    job, _ = load_job(name)
    frames = read_log(log)
    return job, frames, _recognised_marks(log, frames, job) if marked is None else marked.of_recipe(job.recipe.name)


def _checked_marks(path: Path, recipe: str | None) -> Annotations:
    """Errors: LogError where the file marks nothing, or several recipes' dwells and none was named."""
    marks = read_marks(path)
    if not marks.marks:
        raise LogError("marks-empty", file=str(path))
    if recipe is None and len(marks.recipes()) > 1:
        raise LogError("marks-of-several-recipes", file=str(path), recipes=marks.recipes())
    return marks


def decode_log(log: Path, dbc: Path, out: Path | None, *, as_json: bool) -> int:
    """Decodes every frame of a log and says what came; the exit code."""
    layouts = read_layouts(dbc, {})
    frames = read_log(log)
    document = {"schema": "station.decode/1", "log": str(log), "frames": len(frames), **_summary(frames, layouts)}
    if out is not None:
        _write_signals(out, frames, layouts)
    if as_json:
        _output.print_json(document)
        return 0
    _output.print_line(f"{len(frames)} frames, {document['unknown_frames']} with identifiers that are not in {dbc}")
    for message in document["messages"]:
        _output.print_line(f"{message['name']} (0x{message['can_id']:X}): {message['frames']} frames")
        for signal in message["signals"]:
            low, high, unit = signal["min"], signal["max"], signal["unit"]
            _output.print_line(f"  {signal['name']}: {low:g} to {high:g} {unit}".rstrip())
    return 0


def _recognised_marks(log: Path, frames: Frames, job: Job) -> Annotations:
    """Marks found in the frames themselves. Errors: LogError when no node shows every position at rest."""
    found = [m for node in position_matching.nodes_in(frames, job.layout) for m in _marks_of_node(frames, node, job)]
    if not found and not job.recipe.pose_known:
        raise LogError("no-marks-and-no-poses", log=str(log), recipe=job.recipe.name)
    if not found:
        raise LogError("log-without-marks", log=str(log), recipe=job.recipe.name, marks=f"{log.name}.marks.csv")
    return Annotations(marks=tuple(found))


def _marks_of_node(frames: Frames, node: int, job: Job) -> Sequence[Any]:
    return position_matching.annotate_log(frames, job.layout, node, job.recipe)


def _row(u: ReplayedUnit) -> Row:
    return Row(u.seat.serial, f"node {u.seat.node}", u.outcome, u.reasons, u.result, u.noise, u.duration_s)


def _document(units: Sequence[ReplayedUnit], job: Job) -> dict[str, Any]:
    return {
        "schema": "station.calibration/1",
        "recipe": {"name": job.recipe.name, "version": job.recipe.version},
        "method": job.recipe.method,
        "unit": job.recipe.unit,
        "units": [_unit(u) for u in units],
    }


def _unit(u: ReplayedUnit) -> dict[str, Any]:
    which = {"attempt": u.attempt} if u.attempt else {}
    return {**unit_document(_row(u)), "node": u.seat.node, **which, "noise": u.noise}


def _summary(frames: Frames, layouts: Mapping[str, FrameLayout]) -> dict[str, Any]:
    known = np.array([layout.can_id for layout in layouts.values()], np.uint32)
    errors = (frames.can_id & np.uint32(ERROR)) != 0
    messages = [m for m in (_message(frames, layout) for layout in layouts.values()) if m["frames"]]
    return {
        "error_frames": int(np.count_nonzero(errors)),
        "unknown_frames": int(np.count_nonzero(~np.isin(frames.can_id, known) & ~errors)),
        "messages": messages,
    }


def _message(frames: Frames, layout: FrameLayout) -> dict[str, Any]:
    found = decode(frames, layout)
    signals = []
    for signal in layout.signals:
        values = found.values[signal.name]
        values = values[found.present[signal.name]] if signal.name in found.present else values
        if len(values):
            low, high, mean = float(np.min(values)), float(np.max(values)), float(np.mean(values, dtype=float))
            row = {
                "name": signal.name,
                "unit": signal.unit,
                "count": len(values),
                "min": low,
                "max": high,
                "mean": mean,
            }
            signals.append(row)
    return {"name": layout.name, "can_id": layout.can_id, "frames": len(found.rows), "signals": signals}


def _write_signals(out: Path, frames: Frames, layouts: Mapping[str, FrameLayout]) -> None:
    """One row a signal value: frame number, time, message, signal, value."""
    if out.suffix.lower() != ".csv":
        raise UsageError("option-ending", option="--out", path=str(out), endings=[".csv"])
    try:
        with out.open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(["frame", "time_ns", "message", "signal", "value"])
            for layout in layouts.values():
                rows.writerows(_values(frames, layout))
    except OSError as exc:
        raise UsageError("file-not-written", file=str(out), why=system_reason(exc)) from None


def _values(frames: Frames, layout: FrameLayout) -> Iterator[tuple[int, int, str, str, Any]]:
    found = decode(frames, layout)
    time_ns = frames.time_ns[found.rows].tolist()
    for signal in layout.signals:
        present = found.present.get(signal.name, np.ones(len(found.rows), bool))
        columns = zip(found.rows.tolist(), time_ns, found.values[signal.name].tolist(), present, strict=True)
        yield from ((row, at, layout.name, signal.name, value) for row, at, value, there in columns if there)
