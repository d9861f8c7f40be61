"""Marks beside a CAN log: `<log>.marks.json` or `<log>.marks.csv`."""

import csv
import json
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from station.domain.capture.annotations import Annotation, Annotations
from station.errors import LogError

COLUMNS = ("unit", "node", "run", "visit", "position", "start_s", "end_s", "seating")
#: Beyond this a file holds no marks.
MOST_BYTES = 50_000_000


def find_marks_file(log: Path) -> Path | None:
    """The marks of a log, when there are some."""
    for ending in (".marks.json", ".marks.csv"):
        for path in (log.with_name(log.name + ending), log.with_suffix(ending)):
            if path.is_file():
                return path
    return None


def read_marks(path: Path) -> Annotations:
    """Reads marks by the file's ending. Errors: LogError with file, line and column."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise LogError(f"{path} is larger than {MOST_BYTES} bytes; these are no marks")
        text = path.read_text(encoding="utf-8-sig")
    except OSError as exc:
        raise LogError(f"{path} cannot be read ({exc.strerror}); correct the path") from None
    except UnicodeDecodeError as exc:
        raise LogError(f"{path} is no text: byte {exc.start} is not UTF-8; save it as UTF-8") from None
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
        return Annotations.model_validate(json.loads(text))
    except json.JSONDecodeError as exc:
        raise LogError(f"{path} line {exc.lineno}: this is not JSON: {exc.msg}") from None
    except ValidationError as exc:
        raise LogError(f"{path}: {_first(exc)}") from None
    except RecursionError:
        raise LogError(f"{path} is nested too deeply; these are no marks") from None


def _of_csv(path: Path, text: str) -> Annotations:
    rows = csv.DictReader(text.splitlines())
    missing = [c for c in COLUMNS[:-1] if c not in (rows.fieldnames or ())]
    if missing:
        what = f"column {missing[0]} is" if len(missing) == 1 else f"columns {', '.join(missing)} are"
        raise LogError(f"{path} line 1: the {what} missing; a marks table has {', '.join(COLUMNS)}")
    marks = []
    for row in rows:
        told: dict[str, Any] = {c: row[c] for c in COLUMNS if row.get(c)}
        try:
            marks.append(Annotation.model_validate(told))
        except ValidationError as exc:
            raise LogError(f"{path} line {rows.line_num}: {_first(exc)}") from None
    return Annotations(marks=tuple(marks))


def _first(exc: ValidationError) -> str:
    error = exc.errors(include_url=False, include_input=False)[0]
    key = ".".join(str(p) for p in error["loc"])
    return f"{key}: {error['msg'][0].lower()}{error['msg'][1:]}"
