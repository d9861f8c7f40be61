"""The wish to end a run, from outside it: a signal, which needs no page, no network and no free connection."""

import os
import signal
from pathlib import Path

from station.errors import StationFault, UsageError
from station.messages import system_reason
from station.panel_protocol.owner import owner_pid


def request_stop(database: Path) -> int:
    """Asks the run on this log to stop and park, as Ctrl-C does; its pid. Errors: UsageError where there is none."""
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
