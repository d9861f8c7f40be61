"""The work of `station export --parquet`."""

from collections.abc import Sequence
from pathlib import Path

from station.cli import _output
from station.errors import UsageError
from station.messages import Message, system_reason
from station.ports.log_reader import Attempt, LogReader
from station.service.fleet_rows import fleet_rows
from station.wiring.sample_files import FLEET_SCHEMA, FLEET_TABLES, FleetWriter


def export_fleet(log: LogReader, attempts: Sequence[Attempt], folder: Path, as_json: bool) -> int:
    """Writes the tables and says how much; a day that is there is written anew. Errors: UsageError, LogError."""
    if folder.exists() and not folder.is_dir():
        raise UsageError("export-folder-file", path=str(folder), option="--parquet")
    head = log.head()
    writer = FleetWriter(folder, f"{head.number}:{head.hash}")
    try:
        with _output.progress() as bar:
            task = bar.add_task("tables", total=len(attempts))
            for rows in fleet_rows(log, attempts):
                for table in FLEET_TABLES:
                    writer.add(table, rows.product, rows.day, getattr(rows, table))
                bar.advance(task)
        writer.finish()
    except OSError as error:
        raise UsageError("file-not-written", file=str(folder), why=system_reason(error)) from error
    finally:
        writer.abandon()
    if as_json:
        document = {"schema": FLEET_SCHEMA, "folder": str(folder), "files": writer.files, "rows": writer.counts}
        _output.print_json(document | {"head": {"number": head.number, "hash": head.hash}})
        return 0
    _output.print_message(Message("export-fleet", folder=str(folder), files=writer.files, **writer.counts))
    return 0
