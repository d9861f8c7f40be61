"""The work of `station segment`: read numbers, find rest, name the stops."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from station.cli import _output
from station.config.recipes import load_recipe
from station.domain.capture import rest_segments
from station.domain.core.types import Floats
from station.domain.evaluation.quality import FACE_DEG
from station.domain.recipe.recipe import Recipe
from station.errors import SamplesError, UsageError
from station.wiring.sample_files import write_samples


@dataclass(frozen=True, slots=True)
class Recording:
    """A text file of readings: its columns for time, x, y, z, and how raw readings become the recipe's unit."""

    path: Path
    columns: tuple[str, ...]
    rate_hz: float | None
    zero: float
    scale: float


def segment(recording: Recording, serial: str, recipe_name: str | None, out: Path) -> int:
    """Writes the still stretches of a recording as visits. Errors: SamplesError, UsageError, RecipeError."""
    time_s, reading = read_recording(recording)
    stretches = rest_segments.find(time_s, reading)
    names = [f"still-{i + 1:02d}" for i in range(len(stretches))]
    if recipe_name is not None:
        named = _positions(load_recipe(recipe_name), np.array([reading[a:b].mean(axis=0) for a, b in stretches]))
        stretches = stretches[[i for i, name in enumerate(named) if name]]
        names = [name for name in named if name]
    if not names:
        raise SamplesError(f"{recording.path} lies still nowhere that counts; record each stop for some seconds")
    write_samples(rest_segments.table(time_s, reading, stretches, serial, names), out)
    _output.print_remark(f"{len(names)} still stretches of {recording.path} are visits of {out}: {', '.join(names)}")
    return 0


def _positions(recipe: Recipe, mean: Floats) -> list[str]:
    """The nearest position of each mean reading (k, 3); '' where none is within FACE_DEG."""
    if not recipe.pose_known:
        raise UsageError(f"recipe {recipe.name} knows no poses to name stops by; leave --recipe out")
    true = np.array([recipe.true_vector(p) for p in recipe.positions])
    sizes = np.linalg.norm(mean, axis=1)[:, None] * np.linalg.norm(true, axis=1)
    cosines = (mean @ true.T) / np.maximum(sizes, 1e-300)
    best = cosines.argmax(axis=1)
    near = cosines.max(axis=1) > np.cos(np.deg2rad(FACE_DEG))
    return [recipe.positions[b].name if ok else "" for b, ok in zip(best, near, strict=True)]


def read_recording(recording: Recording) -> tuple[Floats, Floats]:
    """Time (n) in s from 0, and readings (n, 3). Errors: SamplesError, UsageError."""
    if len(recording.columns) != 4:
        told = ",".join(recording.columns)
        raise UsageError(f"--columns {told} names {len(recording.columns)} columns; name time, x, y, z")
    rows = _split_lines(recording.path)
    header = rows[0][1] if rows and not _is_number(rows[0][1][0]) else None
    places = [_column_index(recording.path, column, header) for column in recording.columns]
    numbers = np.array([_numbers(recording.path, row, places) for row in (rows[1:] if header else rows)])
    if len(numbers) == 0:
        raise SamplesError(f"{recording.path} holds no readings; give a text file with a row a reading")
    time_s = np.arange(len(numbers)) / recording.rate_hz if recording.rate_hz else numbers[:, 0] - numbers[0, 0]
    return time_s, (numbers[:, 1:] - recording.zero) * recording.scale


def _split_lines(path: Path) -> list[tuple[int, list[str]]]:
    """Line numbers and cells of a text; split at commas where there are any, else at blanks."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as exc:
        raise SamplesError(f"{path} cannot be read as text; give a CSV or a table of numbers") from exc
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    comma = bool(lines) and "," in lines[0][1]
    return [(i, [c.strip() for c in line.split(",")] if comma else line.split()) for i, line in lines]


def _column_index(path: Path, column: str, header: list[str] | None) -> int:
    if header is not None and column in header:
        return header.index(column)
    if column.isdigit():
        return int(column)
    known = "has no header" if header is None else f"has the columns {', '.join(header)}"
    raise SamplesError(f"{path} {known}, not {column!r}; name columns that exist, or number them from 0, in --columns")


def _numbers(path: Path, row: tuple[int, list[str]], places: list[int]) -> list[float]:
    line, cells = row
    try:
        numbers = [float(cells[i]) for i in places]
    except (ValueError, IndexError) as exc:
        told = ", ".join(map(str, places))
        raise SamplesError(f"{path}, line {line}: columns {told} are not four numbers; see --columns") from exc
    if not np.isfinite(numbers).all():
        raise SamplesError(f"{path}, line {line}: a reading is no finite number; remove the line")
    return numbers


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
