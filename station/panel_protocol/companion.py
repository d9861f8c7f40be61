"""The files beside a log by which a run and the page find each other: `station.db` + `.live.json`."""

from enum import StrEnum
from pathlib import Path

from station.errors import StoreFault
from station.files.real_path import real_path
from station.messages import Message


class Companion(StrEnum):
    """Endings, after the log's whole name."""

    LIVE = ".live.json"  # station.live/1, by the run: what goes on
    ANSWER = ".answer.json"  # station.answer/1, by the page: the mark of the confirmed question
    QUEUE = ".queue.json"  # station.queue/1, by the page: units of the loads to come
    READINGS = ".readings.json"  # station.readings/1, by the page's listener: what the units in the nests send
    PRESENCE = ".panel.lock"  # shared lock of every page that serves this log
    OWNER = ".lock"  # lock of the run that writes the log
    STOP = ".stop"  # datagram socket of the run: whoever may write to it may stop it
    SEALING = ".sealing"  # datagram socket of the run: takes what its user seals into the log meanwhile
    ERRORS = ".run.err"  # standard error of the run that the page started
    JOURNAL = ".panel.jsonl"  # station.panel-journal/1, by the page: who did what
    SHIPPING = ".shipping.json"  # station.shipping/1, by whoever ships: how far the plants have the log
    SHIPPER = ".ship.lock"  # lock of the process that ships
    ALERTS = ".alerts.json"  # station.alerts/1, by `station watch --follow`: alerts, and who has got them
    LINE = ".line.json"  # station.line/1, by `station line`: its outer state, load and counts
    LINE_COMMAND = ".line-command.json"  # station.line-command/1, by who serves or steers the line: a PackML command
    LINE_ADJUSTMENT = ".line-adjustment.json"  # station.line-adjustment/1, by who serves it: unit mode, a few times
    QUESTIONS = ".questions.json"  # station.questions/1, by the page: saved questions of the audit
    DIAGNOSES = ".diagnoses"  # folder of the page's diagnoses


def companion_file(database: Path, ending: Companion) -> Path:
    """That file of this log, by whatever link the log is reached. Errors: StoreFault where the path has no name, as `/`
    has none."""
    real = real_path(database)
    if not real.name:
        raise StoreFault("log-not-opened", path=str(database), reason=Message("log-is-folder"))
    return real.with_name(real.name + ending.value)
