"""`station audit SERIAL --bundle FILE`: the evidence of one attempt as one file."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from station.cli import _output
from station.errors import LogError, UsageError
from station.files.replace import replacing
from station.messages import Message, system_reason
from station.ports.log_reader import Query
from station.reporting.words import words_of

if TYPE_CHECKING:
    from station.ports.log_reader import LogReader


def write_bundle(log: "LogReader", query: Query, path: Path) -> int:
    """Writes the bundle of the newest ended attempt that the query names. Errors: UsageError, LogError."""
    if query.serial is None:
        raise UsageError("bundle-needs-serial")
    ended = [a for a in log.attempts(replace(query, before=None)) if a.outcome is not None]
    if not ended:
        raise LogError("log-no-such-attempt-of", log=log.location, serial=query.serial)
    from station.service.evidence import bundle

    try:
        with _output.activity(Message("activity-writing", file=str(path))), replacing(path) as part:
            part.write_bytes(bundle(log, ended[0], words_of("en")))
    except OSError as exc:
        raise UsageError("option-not-written", option="--bundle", path=str(path), why=system_reason(exc)) from exc
    _output.print_line(str(path))
    return 0
