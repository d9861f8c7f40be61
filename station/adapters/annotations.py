"""Marks beside a CAN log: `<log>.marks.json` or `<log>.marks.csv`."""

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from station.config.validation_messages import mistakes
from station.domain.capture.annotations import Annotation, Annotations
from station.errors import LogError
from station.files.json_text import parse_json
from station.messages import Message, system_reason

REQUIRED = ("unit", "node", "run", "visit", "position", "start_s", "end_s")
COLUMNS = (*REQUIRED, "seating", "attempt", "simulated", "recipe")
#: Beyond these a file holds no marks: 127 nests, 24 positions, 4 runs come to 12,192 marks of some 150 bytes.
MOST_BYTES, MOST_MARKS = 5_000_000, 20_000


def find_marks_file(log: Path) -> Path | None:
    """The marks of a log, when there are some."""
    for ending in (".marks.json", ".marks.csv"):
        for path in (log.parent / (log.name + ending), log.parent / (log.stem + ending)):
            if path.is_file():
                return path
    return None


def read_marks(path: Path) -> Annotations:
    """Reads marks by the file's ending. Errors: LogError with file, line and column."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise LogError("file-too-long", file=str(path), limit=MOST_BYTES)
        text = path.read_text(encoding="utf-8-sig")
    except OSError as exc:
        raise LogError("file-unreadable", file=str(path), why=system_reason(exc)) from None
    except UnicodeDecodeError as exc:
        raise LogError("file-not-utf8", file=str(path), byte=exc.start) from None
    return _of_csv(path, text) if path.suffix.lower() == ".csv" else _of_json(path, text)


def write_marks(path: Path, marks: Annotations) -> None:
    """Writes marks by the file's ending."""
    if path.suffix.lower() == ".csv":
        with path.open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(COLUMNS)
            rows.writerows([getattr(mark, column) for column in COLUMNS] for mark in marks.marks)
    else:
        path.write_text(json.dumps(marks.model_dump(by_alias=True), indent=1), encoding="utf-8")


def _of_json(path: Path, text: str) -> Annotations:
    try:
        document = parse_json(text)
        _check_count(path, len(document["marks"]) if isinstance(document, dict) and "marks" in document else 0)
    except json.JSONDecodeError as exc:
        why = Message("line-not-json", column=exc.colno)
        raise LogError("line-of-file", file=str(path), line=exc.lineno, reason=why) from None
    except (ValueError, TypeError):
        raise LogError("file-nested-too-deep", file=str(path)) from None
    try:
        return Annotations.model_validate(document)
    except ValidationError as exc:
        reasons = mistakes(exc, Annotations)
        raise LogError("document-mistakes", file=str(path), mistakes=reasons) from None


def _whole_rows(path: Path, rows: "csv.DictReader[str]") -> Iterator[dict[str, str]]:
    """The rows. Errors: LogError where one is no CSV."""
    try:
        yield from rows
    except csv.Error:
        raise LogError("samples-line-not-csv", file=str(path), line=rows.line_num + 1) from None


def _check_count(path: Path, marks: int) -> None:
    if marks > MOST_MARKS:
        raise LogError("marks-too-many", file=str(path), marks=marks, limit=MOST_MARKS)


def _of_csv(path: Path, text: str) -> Annotations:
    lines = text.splitlines()
    _check_count(path, len(lines))
    rows = csv.DictReader(lines)
    missing = [c for c in REQUIRED if c not in (rows.fieldnames or ())]
    if missing:
        raise LogError("marks-columns-missing", file=str(path), missing=missing, columns=COLUMNS)
    marks = []
    for row in _whole_rows(path, rows):
        cells: dict[str, Any] = {c: row[c] for c in COLUMNS if row.get(c)}
        try:
            marks.append(Annotation.model_validate(cells))
        except ValidationError as exc:
            reason = mistakes(exc, Annotation)[0]
            raise LogError("line-of-file", file=str(path), line=rows.line_num, reason=reason) from None
    return Annotations(marks=tuple(marks))
