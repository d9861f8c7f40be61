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
    pid = owner_pid(database)
    if pid is None:
        raise UsageError("no-run-under-way")
    signal_stop(pid)
    return pid


def signal_stop(pid: int) -> None:
    """Asks that run. Errors: StationFault where it is another user's."""
    try:
        os.kill(pid, signal.SIGINT)
    except OSError as exc:
        raise StationFault("run-not-stopped", pid=pid, why=system_reason(exc)) from exc
