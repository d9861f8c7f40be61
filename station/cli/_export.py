"""The work of `station export`: each file is written beside its place and moved there whole."""

import csv
import hashlib
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

from station.cli import _output
from station.domain.records.stored_attempt import MARK, is_simulated
from station.errors import LogError, UsageError
from station.files.replace import replacing
from station.messages import Message, render, system_reason
from station.ports.log_reader import Attempt, LogReader, Query
from station.service import frame_export, stored_attempts
from station.service.witnessed import newest_receipt

RESULTS_SCHEMA = "station.results/1"
_ENDINGS = {"samples": (".parquet", ".csv"), "results": (".parquet", ".csv", ".json"), "frames": (".log", ".blf")}


@dataclass(frozen=True, slots=True)
class ExportFiles:
    """Files to write, or None."""

    samples: Path | None
    results: Path | None
    frames: Path | None

    def check(self) -> None:
        """UsageError where nothing is wanted, or a name says nothing that can be written."""
        given = {name: path for name, path in asdict(self).items() if path is not None}
        if not given:
            raise UsageError("export-nothing-named")
        for name, path in given.items():
            if path.suffix.lower() not in _ENDINGS[name]:
                raise UsageError("option-ending", option=f"--{name}", path=str(path), endings=_ENDINGS[name])
            if not path.parent.is_dir():
                raise UsageError("option-no-folder", option=f"--{name}", path=str(path), folder=str(path.parent))


def select_attempts(log: LogReader, query: Query, serials: Sequence[str], ids: Sequence[str]) -> list[Attempt]:
    """The attempts meant, oldest first. Errors: LogError when there is none."""
    queries = [replace(query, serial=serial) for serial in serials] or [query]
    found = {a.number: a for q in queries for a in log.attempts(q) if not ids or a.attempt in ids}
    if not found:
        raise LogError("log-no-such-attempt", log=log.location)
    return [found[number] for number in sorted(found)]


def export(log: LogReader, attempts: Sequence[Attempt], wanted: ExportFiles, *, as_json: bool) -> int:
    """Writes what is wanted and says so; the exit code."""
    wanted.check()
    files = []
    if wanted.samples is not None:
        files.append(_file(log, attempts, wanted.samples, lambda path: _samples(log, attempts, path)))
    if wanted.results is not None:
        files.append(_file(log, attempts, wanted.results, lambda path: _results(log, attempts, path)))
    if (frames := wanted.frames) is not None:
        files.append(_file(log, attempts, frames, lambda path: _frames(log, attempts, path, _marks_of(frames))))
        files[-1]["marks"] = str(_marks_of(frames))
    if as_json:
        _output.print_json({"schema": "station.export/1", "files": files})
        return 0
    for entry in files:
        _output.print_line(
            f"{entry['path']}: {entry['rows']} {entry['what']} of {len(attempts)} attempts, sha256 {entry['sha256']}"
        )
    _output.print_line(f"head of {log.location}: {files[0]['head']['number']}:{files[0]['head']['hash']}")
    return 0


def _file(log: LogReader, attempts: Sequence[Attempt], path: Path, write: Any) -> dict[str, Any]:
    """Writes one file and, beside it, what it is and what log it came from."""
    with _atomic_file(path) as unfinished:
        what, rows = write(unfinished)
    entry = {
        "path": str(path),
        "what": what,
        "rows": rows,
        "sha256": _sha256(path),
        "log": log.location,
        "head": asdict(log.head()),
        "witness": newest_receipt(log),
        "attempts": [a.attempt for a in attempts],
        "simulated": [a.attempt for a in attempts if is_simulated(a.software)],
    }
    sidecar = path.with_name(path.name + ".export.json")
    with _atomic_file(sidecar) as unfinished:
        unfinished.write_text(json.dumps({"schema": "station.export/1", **entry}, indent=1), encoding="utf-8")
    return entry


def _samples(log: LogReader, attempts: Sequence[Attempt], path: Path) -> tuple[str, int]:
    from station.wiring.sample_files import write_parts

    rows = 0

    def counted() -> Iterator[Any]:
        nonlocal rows
        with _output.progress() as bar:
            task = bar.add_task("samples", total=len(attempts))
            for table in stored_attempts.samples(log, attempts):
                rows += len(table)
                bar.advance(task)
                yield table

    tables = counted()
    first = next(tables, None)
    if first is None:
        raise LogError("export-no-visits")
    head = log.head()
    write_parts(chain([first], tables), path, {"head": f"{head.number}:{head.hash}"})
    return "samples", rows


def _results(log: LogReader, attempts: Sequence[Attempt], path: Path) -> tuple[str, int]:
    with _output.activity(Message("activity-writing", file=path.name)):
        rows = list(stored_attempts.results(log, attempts))
    if path.suffix.lower() == ".json":
        document = {
            "schema": RESULTS_SCHEMA,
            "head": asdict(log.head()),
            "witness": newest_receipt(log),
            "results": rows,
        }
        path.write_text(json.dumps(document, ensure_ascii=False, indent=1), encoding="utf-8")
    elif path.suffix.lower() == ".csv":
        with path.open("w", encoding="utf-8", newline="") as file:
            table = csv.DictWriter(file, list(rows[0]))
            table.writeheader()
            table.writerows({name: _escape_formula(value) for name, value in row.items()} for row in rows)
    else:
        _results_parquet(rows, log, path)
    return "results", len(rows)


def _escape_formula(value: Any) -> Any:
    """A text that a spreadsheet would take for a formula, marked as text; figures are no text."""
    return f"'{value}" if isinstance(value, str) and value[:1] in "=+-@\t\r" and value else value


def _results_parquet(rows: Sequence[dict[str, Any]], log: LogReader, path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    head = log.head()
    table = pa.Table.from_pylist(list(rows))
    parquet.write_table(
        table.replace_schema_metadata({"schema": RESULTS_SCHEMA, "head": f"{head.number}:{head.hash}"}), path
    )


def _frames(log: LogReader, attempts: Sequence[Attempt], path: Path, marks_file: Path) -> tuple[str, int]:
    from station.wiring.recordings import write_log, write_marks

    with _output.activity(Message("activity-writing", file=path.name)):
        found, marks = frame_export.frames(log, attempts)
        write_log(path, found, _channel(attempts))
    with _atomic_file(marks_file) as unfinished:
        write_marks(unfinished, marks)
    if len(marks.recipes()) > 1:
        _output.print_remark(render(Message("export-several-recipes", recipes=marks.recipes())))
    unmarked = sorted({a.serial for a in attempts} - {mark.unit for mark in marks.marks})
    if unmarked:
        _output.print_remark(render(Message("export-without-marks", serials=unmarked)))
    return "frames", len(found)


def _channel(attempts: Sequence[Attempt]) -> str:
    """What a log of frames calls its bus: frames of simulated devices say so in every line."""
    return next((MARK for a in attempts if is_simulated(a.software)), "can0")


def _marks_of(path: Path) -> Path:
    return path.with_name(path.name + ".marks.csv")


@contextmanager
def _atomic_file(path: Path) -> Iterator[Path]:
    """A place to write to; the file appears under its name only when it is whole and on the disk."""
    try:
        with replacing(path, durable=True) as unfinished:
            yield unfinished
    except OSError as exc:
        raise UsageError("file-not-written", file=str(path), why=system_reason(exc)) from exc


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
