"""The work of `station export --wsjf`."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from station.cli import _output
from station.errors import LogError, UsageError
from station.files.replace import replacing
from station.messages import Message, system_reason
from station.ports.log_reader import Attempt, LogReader
from station.reporting.certificate import wsjf


def export_wsjf(log: LogReader, attempts: Sequence[Attempt], folder: Path, as_json: bool) -> int:
    """Writes ATTEMPT.json of every attempt that has ended, and says how many. Errors: UsageError, LogError."""
    if folder.exists() and not folder.is_dir():
        raise UsageError("export-folder-file", path=str(folder), option="--wsjf")
    files = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with _output.progress() as bar:
            task = bar.add_task("reports", total=len(attempts))
            for attempt in attempts:
                stored = log.attempt(attempt)
                if stored["outcome"]:
                    files.append(folder / f"{attempt.attempt}.json")
                    with replacing(files[-1]) as part:
                        part.write_text(json.dumps(wsjf.to_wsjf(stored), ensure_ascii=False), encoding="utf-8")
                bar.advance(task)
    except OSError as error:
        raise UsageError("file-not-written", file=str(folder), why=system_reason(error)) from error
    if not files:
        raise LogError("export-none-ended")
    if as_json:
        head = asdict(log.head())
        _output.print_json({"schema": "station.export/1", "files": [{"path": str(f)} for f in files], "head": head})
        return 0
    _output.print_message(Message("export-wsjf", folder=str(folder), files=len(files)))
    return 0
