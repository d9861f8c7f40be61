"""What every screen shows right now, as one flat mapping: screens are sent the keys whose values changed."""

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

from station.config.settings import Settings
from station.errors import StationError, StoreFault
from station.messages import Message
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.queue import LoadQueue
from station.reporting.drawing import fixture
from station.service.golden_register import standings
from station.web import language
from station.web.run_launcher import RunLauncher
from station.wiring.bus_status import state_of
from station.wiring.buses import bus_kind
from station.wiring.logs import find_log

#: A value older than this is looked up again, s: the rate at which all screens together look.
LIVE_MAX_AGE_S = 0.03
#: So often the kernel is asked for the state of the bus between runs, s.
BUS_POLL_S = 0.5
#: And so often whether the golden units are due, s.
GOLDEN_POLL_S = 5.0


class Screen:
    """Folds the run's live file, the lock and the queue together. Every look is at most FRESH_S old."""

    def __init__(self, settings: Settings, runs: RunLauncher, queue: LoadQueue) -> None:
        self._golden: tuple[float, str] = (-GOLDEN_POLL_S, "")
        self._settings, self._runs, self._queue = settings, runs, queue
        self._between: tuple[float, dict[str, Any]] = (-BUS_POLL_S, {})
        self._path = companion_file(runs.order.database, Companion.LIVE)
        self._stamp: tuple[int, int] | None = None
        self._live: dict[str, Any] = {}
        self._shown: dict[str, Any] = {}
        self._looked_s = 0.0
        self._pictures: dict[str, str] = {}
        self.stopping = False

    def shown(self) -> Mapping[str, Any]:
        """Key → value; a key's value is replaced as a whole."""
        now_s = time.monotonic()
        if now_s - self._looked_s > LIVE_MAX_AGE_S:
            self._looked_s = now_s
            self._refresh()
            self._shown = self._compose()
        return self._shown

    def state(self) -> dict[str, Any]:
        """The run's own state as it last told it, empty when there never was one."""
        self._refresh()
        found: dict[str, Any] = self._live.get("state", {})
        return found

    def question(self) -> tuple[str, str]:
        """What the run wants a person to do and confirm, and the mark that the answer must bear; '' where nothing."""
        state = self.state() if self._live.get("pid") == self._runs.pid() else {}
        return language.sentence(state.get("confirm"), "en"), state.get("question", "")

    def load_pid(self) -> int:
        """Pid of the run whose units are in the nests at this moment, 0 when none is under way."""
        return self._runs.pid() or 0

    def units_in_progress(self) -> dict[str, str]:
        """Serial → nest of what a run was given and has not ended."""
        state = self.state() if self._live.get("pid") == self._runs.pid() else {}
        measured = {n["serial"]: n["nest"] for n in state.get("nests", ()) if not n["outcome"]}
        return measured | {w.serial: nest for nest, w in self._queue.handed.items()}

    def unfinished(self) -> dict[str, str]:
        """Nest → serial of the units of the last load that neither passed nor failed."""
        return {n["nest"]: n["serial"] for n in self.state().get("nests", ()) if n["outcome"] not in ("PASS", "FAIL")}

    def _refresh(self) -> None:
        """Reads the live file again when it is another one; a file in between keeps the last."""
        try:
            stat = self._path.stat()
            stamp = (stat.st_ino, stat.st_mtime_ns)
            if stamp != self._stamp:
                self._live = json.loads(self._path.read_bytes())
                self._stamp = stamp
        except FileNotFoundError:
            self._live, self._stamp = {}, None
        except (OSError, ValueError):
            return

    def _compose(self) -> dict[str, Any]:
        pid = self._runs.pid()
        running = pid is not None
        state: dict[str, Any] = self._live.get("state", {})
        unkept = self._settle_queue(pid)
        mine = running and self._live.get("pid") == pid
        self.stopping = self.stopping and running
        poses, at = self._live.get("poses", ()), state.get("at", -1)
        now, following = (state.get(k, "") if mine else "" for k in ("position", "following"))
        return {
            "running": running,
            "stopping": self.stopping,
            "phase": state.get("phase", "") if mine else "begin" if running else "",
            "position": now,
            "following": following,
            "now_svg": self._picture(poses, at, now),
            "next_svg": self._picture(poses, at + 1, following),
            "instruction": state.get("instruction") if mine else None,
            "confirm": {k: state.get(k) or "" for k in ("confirm", "question")} if mine else {},
            "waiting": {nest: w.serial for nest, w in self._queue.waiting.items()},
            "writing": state.get("writing", "") if mine else "",
            "done": state.get("done", 0) if mine or not running else 0,
            "total": state.get("total", 0) if mine or not running else 0,
            "began_s": state.get("began_s", 0.0) if mine else 0.0,
            "estimate_s": state.get("estimate_s", 0.0) if mine else 0.0,
            "bus": self._bus(mine=mine),
            "unit": self._live.get("unit", ""),
            "recipe": self._live.get("recipe", self._runs.order.recipe),
            "messages": state.get("messages", []) if mine or not running else [],
            "fault": self._fault(state, running=running) or unkept,
            "golden": self._golden_problem(),
            **{f"nest {n.name}": self._nest(n.name, state, running=running, mine=mine) for n in self._settings.nests},
        }

    def _settle_queue(self, pid: int | None) -> str:
        """Lets go of the units that the run has begun; '' or why that could not be kept."""
        try:
            self._queue.settle(begun=self._live.get("pid"), running=pid)
        except StoreFault as exc:
            return exc.sentence
        return ""

    def _nest(self, name: str, state: Mapping[str, Any], *, running: bool, mine: bool) -> dict[str, Any]:
        """What is in a nest, and what comes next. A verdict stays until the unit that was scanned after it takes over;
        one that was scanned during the run waits beside the verdict, because the other unit is still in the nest."""
        waits, handed = self._queue.waiting.get(name), self._queue.handed.get(name)
        entry = next((n for n in state.get("nests", ()) if n["nest"] == name), None)
        if running and not mine:
            there = {"serial": handed.serial if handed else "", "scanned": handed is not None}
        elif not running and waits is not None and waits.beside != self._live.get("pid"):
            return {"serial": waits.serial, "scanned": True, "next": ""}
        else:
            there = {**(entry or {"serial": ""}), "scanned": False}
        return {**there, "next": waits.serial if waits else ""}

    def _fault(self, state: Mapping[str, Any], *, running: bool) -> Mapping[str, Any] | str:
        """Why there is no run, where it did not end by itself."""
        if running:
            return ""
        if self._runs.started not in (None, self._live.get("pid")):
            return self._runs.last_words() or Message("run-not-begun").document()
        if self._live and not state.get("over", False):
            return self._runs.last_words() or Message("run-ended-silently").document()
        return state.get("fault") or ""

    def _golden_problem(self) -> str:
        """What is due or wrong with the golden units, looked up every few seconds; '' when all is well."""
        at_s, problem = self._golden
        if time.monotonic() - at_s > GOLDEN_POLL_S:
            try:
                found = standings(self._settings, partial(find_log, self._runs.order.database))
                problem = "; ".join(s.problem for s in found if s.problem)
            except StationError as exc:
                problem = exc.sentence
            self._golden = (time.monotonic(), problem)
        return problem

    def _bus(self, *, mine: bool) -> dict[str, Any]:
        """State and error counters: as the run tells them, and between runs as the kernel does for its interface."""
        if mine:
            return dict(self._live.get("bus") or {})
        if self._runs.order.simulate or not bus_kind(self._settings.bus).interface_of_kernel:
            return {}
        if time.monotonic() - self._between[0] > BUS_POLL_S:
            name = self._settings.bus.channel
            state, counters = state_of(name)
            status = {"name": name, "state": state, "counters": asdict(counters) if counters else None}
            self._between = (time.monotonic(), status)
        return self._between[1]

    def _picture(self, poses: Sequence[Any], number: int, name: str) -> str:
        """The block at the stop of that number; the same position in another seating is another picture."""
        if not name:
            return ""
        pose = poses[number] if 0 <= number < len(poses) else None
        key = f"{name} {pose}"
        if key not in self._pictures:
            self._pictures = dict(list(self._pictures.items())[-200:])
            self._pictures[key] = fixture.picture(pose, name)
        return self._pictures[key]
