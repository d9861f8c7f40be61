"""The work of `station watch`: alerts as sentences, or as one JSON document a line."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from station.cli import _output
from station.config.settings import load_settings
from station.domain.watch.e_detector import LEARN
from station.messages import Message, render
from station.ports.log_reader import LogReader
from station.service.watch import Finding, Watch
from station.service.watch_report import (
    alert_document,
    alert_remarks,
    alert_remedy,
    alert_sentence,
    containment_command,
)
from station.wiring.alerts import AlertDesk
from station.wiring.logs import find_log

_FOUND, _QUIET = 1, 0


@dataclass(frozen=True, slots=True)
class WatchRequest:
    """every_s: between two readings of the log; None: once over it. since_ns: what ended before is left out."""

    run_length: int
    since_ns: int | None
    every_s: float | None


def wait_for_log(db: Path | None, config: Path | None, every_s: float) -> None:
    """Returns when there is a log: at a new station the first run makes it. Errors: ConfigError, LogError."""
    path = db or Path(load_settings(config).database)
    while (log := find_log(path)) is None:
        time.sleep(every_s)
    log.close()


@contextmanager
def alert_desk(db: Path | None, config: Path | None, *, follow: bool) -> Iterator[AlertDesk | None]:
    """Tells the alerts as config.yaml says; None where it says nothing. Errors: ConfigError, StoreFault."""
    settings = load_settings(config) if follow else None
    if settings is None or settings.alerts is None:
        yield None
        return
    desk = AlertDesk(db or Path(settings.database), settings.alerts, settings.station)
    try:
        yield desk
    finally:
        desk.close()


def run_watch(log: LogReader, request: WatchRequest, desk: AlertDesk | None, *, as_json: bool) -> int:
    """Prints the alerts; 1 when there was any. desk: sends them on. Errors: LogError."""
    watch = Watch(log, request.run_length)
    with _output.activity(Message("activity-log", log=log.location)):
        watch.read()
    found = [f for f in watch.findings() if f.ended_ns is None or f.ended_ns >= (request.since_ns or 0)]
    for finding in found:
        _show(watch, finding, request, as_json=as_json)
    if not found:
        learning = Message("watch-learning", loads=watch.loads, learn=LEARN)
        _output.print_remark(render(learning if watch.learning else Message("watch-quiet", loads=watch.loads)))
    if desk is not None:
        desk.update(watch)
    while request.every_s is not None:
        time.sleep(request.every_s)
        loads = watch.loads
        for finding in watch.read():
            _show(watch, finding, request, as_json=as_json)
        if desk is not None and watch.loads > loads:
            desk.update(watch)
        if desk is not None:
            desk.deliver()
    return _FOUND if found else _QUIET


def _show(watch: Watch, finding: Finding, request: WatchRequest, *, as_json: bool) -> None:
    units = watch.touched(finding)
    if as_json:
        _output.print_json(alert_document(finding, units, request.run_length))
        return
    _output.print_message(alert_sentence(finding, len(units)))
    for line in (*alert_remarks(finding), alert_remedy(finding.alert.place.signal.kind)):
        _output.print_line("  " + render(line))
    _output.print_command("  " + containment_command(finding))
