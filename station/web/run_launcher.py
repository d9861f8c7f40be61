"""Runs are processes of their own: started in their own session, found again by their lock, stopped by a signal."""

import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from station.errors import StoreFault, UsageError
from station.files.ordinary import open_ordinary, read_ordinary
from station.messages import system_reason
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.owner import owner_pid
from station.panel_protocol.stop import signal_stop
from station.panel_protocol.stop_socket import stop_by_socket

#: A run that repeats itself on its standard error has a long one.
_MOST_ERRORS = 16_000_000


@dataclass(frozen=True, slots=True)
class LaunchOptions:
    """How runs are started from this page; what is None stays as config.yaml says. faults: of simulated units.

    rehearsal: config.yaml itself says that units are simulated, and where they keep what they save.
    """

    database: Path
    recipe: str
    config: Path | None = None
    simulate: bool = False
    pace: float | None = None
    faults: tuple[str, ...] = ()
    rehearsal: bool = False

    def words(self, units: Mapping[str, str], operator: str) -> list[str]:
        """The arguments of `station run` for units, nest → serial; what it asks of a person comes to the page."""
        words = ["run", "--db", str(self.database), "--recipe", self.recipe, f"--operator={operator}", "--ask-at-page"]
        if self.config is not None:
            words += ["--config", str(self.config)]
        if self.simulate and not self.rehearsal:
            words += ["--simulate", "--device-state", f"{self.database}.devices"]
        if self.simulate and self.pace is not None:
            words += ["--pace", f"{self.pace:g}"]
        seats = (word for nest, serial in units.items() for word in (f"--nest={nest}", f"--serial={serial}"))
        return [*words, *self._faults(set(units.values())), *seats]

    def _faults(self, serials: set[str]) -> list[str]:
        """Those of the units of this load, of every unit, of the bus and of the gold reference."""
        whose = {fault: fault.partition("/")[0] if "/" in fault else "" for fault in self.faults}
        return [f"--fault={f}" for f, serial in whose.items() if serial in serials | {"", "BUS", "GOLD"}]


class RunLauncher:
    """Starts and stops runs on one log. Children of this process are reaped whenever somebody asks."""

    def __init__(self, order: LaunchOptions) -> None:
        self.order = order
        self.started: int | None = None
        self._child: subprocess.Popen[bytes] | None = None

    def pid(self) -> int | None:
        """The run on this log: a child that is just starting, or whoever holds the lock."""
        if self._child is not None and self._child.poll() is None:
            return self._child.pid
        self._child = None
        return owner_pid(self.order.database)

    def start(self, units: Mapping[str, str], operator: str) -> int:
        """Starts a run of nest → serial that outlives this process; its pid. UsageError when one is under way."""
        if self.pid() is not None:
            raise UsageError("run-under-way")
        words = [sys.executable, "-P", "-m", "station", *self.order.words(units, operator)]
        with os.fdopen(self._open_errors(), "wb") as errors:
            self._child = subprocess.Popen(
                words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=errors, start_new_session=True
            )
        self.started = self._child.pid
        return self._child.pid

    def stop(self) -> int:
        """Asks the run to stop and park, as Ctrl-C does; its pid. UsageError when there is none."""
        pid = self.pid()
        if pid is None:
            raise UsageError("no-run-under-way")
        if stop_by_socket(self.order.database) is None:  # it has not come so far, or its file system has no sockets
            signal_stop(pid)
        return pid

    def last_words(self) -> str:
        """The last sentence of the last run started here on its standard error, or ''."""
        try:
            text = read_ordinary(self._errors(), _MOST_ERRORS).decode("utf-8", "replace")
        except (OSError, ValueError):
            return ""
        lines = text.strip().splitlines()
        return lines[-1].removeprefix("station: ")[:500] if lines else ""

    def _open_errors(self) -> int:
        """The file of the run's errors, emptied. Errors: StoreFault where a link or a pipe stands there."""
        try:
            return open_ordinary(self._errors(), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        except OSError as exc:
            raise StoreFault("file-not-written", file=str(self._errors()), why=system_reason(exc)) from exc

    def _errors(self) -> Path:
        return companion_file(self.order.database, Companion.ERRORS)
