"""The wish to end a run, from outside it: by its socket, else by a signal; neither needs a page or a network."""

import os
import signal
from pathlib import Path

from station.errors import StationFault, UsageError
from station.messages import system_reason
from station.panel_protocol.owner import owner_pid
from station.panel_protocol.stop_socket import stop_by_socket


def request_stop(database: Path) -> int:
    """Asks the run on this log to stop and park, as Ctrl-C does; its pid. Errors: UsageError where there is none;
    StationFault where it is another user's."""
    if (pid := stop_by_socket(database)) is not None:
        return pid
    pid = require_owner(database)
    signal_stop(pid)
    return pid


def require_owner(database: Path) -> int:
    """The pid of the run on this log. Errors: UsageError where there is none."""
    pid = owner_pid(database)
    if pid is None:
        raise UsageError("no-run-under-way")
    return pid


def kill_owner(database: Path, pid: int) -> None:
    """Ends that run's process where it still has the log. Errors: UsageError where it ended meanwhile; StationFault."""
    if require_owner(database) != pid:
        raise UsageError("no-run-under-way")
    _signal(pid, signal.SIGKILL)


def signal_stop(pid: int) -> None:
    """Asks that run. Errors: StationFault where it is another user's."""
    _signal(pid, signal.SIGINT)


def _signal(pid: int, number: signal.Signals) -> None:
    try:
        os.kill(pid, number)
    except OSError as exc:
        raise StationFault("run-not-stopped", pid=pid, why=system_reason(exc)) from exc
