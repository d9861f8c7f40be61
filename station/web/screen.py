"""What every screen shows right now, as one flat mapping: screens are sent the keys whose values changed."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from threading import RLock
from typing import Any

from station.config.settings import Settings
from station.domain.recipe.recipe import Recipe
from station.errors import StationError, StoreFault
from station.files.json_text import NOT_AS_EXPECTED
from station.messages import Message
from station.panel_protocol import timeline
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.live_state import read_live_state, recipe_label
from station.panel_protocol.nest_readings import NestReading, read_readings
from station.panel_protocol.queue import LoadQueue, QueueState
from station.service.golden_register import standings
from station.service.shipping import ShippingState, sentence_of
from station.web import language, load_view, plan
from station.web.line_glance import LineGlance
from station.web.load_view import View
from station.web.run_launcher import RunLauncher
from station.web.today import LogGlance
from station.wiring.alerts import read_book
from station.wiring.bus_status import state_of
from station.wiring.buses import bus_kind
from station.wiring.logs import find_log, open_log
from station.wiring.shipping import read_statuses

#: A value older than this is looked up again, s: the rate at which all screens together look.
LIVE_MAX_AGE_S = 0.03
#: So often the kernel is asked for the state of the bus between runs, s.
BUS_POLL_S = 0.5
#: And so often what the units in the nests send before a run, s.
READINGS_POLL_S = 0.1
#: And so often how far the plants have the log, s.
SHIPPING_POLL_S = 2.0
#: And so often what the watch has found, s.
WATCH_POLL_S = 2.0
#: And so often whether the golden units are due, s.
GOLDEN_POLL_S = 5.0
Cells = Sequence[Mapping[str, Any]]
#: Of the live file, where the time line is.
_LINE_KEYS = ("cell", "cell_since_s", "warm_until_s", "expected_s")
#: A reading is shown with so many decimals.
_DECIMALS = 4


class Screen:
    """Folds the run's live file, the lock and the queue together. Every look is at most FRESH_S old."""

    def __init__(self, settings: Settings, recipe: Recipe, runs: RunLauncher, queue: LoadQueue) -> None:
        self._shipping: tuple[float, Mapping[str, Any] | str] = (-SHIPPING_POLL_S, "")
        self._watched: tuple[float, Mapping[str, Any] | str] = (-WATCH_POLL_S, "")
        self._golden: tuple[float, str] = (-GOLDEN_POLL_S, "")
        self._settings, self._recipe, self._runs, self._queue = settings, recipe, runs, queue
        self._heard: tuple[float, Mapping[str, NestReading]] = (-READINGS_POLL_S, {})
        self._between: tuple[float, dict[str, Any]] = (-BUS_POLL_S, {})
        self._path = companion_file(runs.order.database, Companion.LIVE)
        self._stamp: tuple[int, int] | None = None
        self._live: dict[str, Any] = {}
        self._shown: dict[str, Any] = {}
        self._turn = RLock()
        self._looked_s = 0.0
        self._outer = LineGlance(runs.order.database)
        self._glance = LogGlance(partial(open_log, runs.order.database))
        self._planned = timeline.cells_of(recipe)
        self._own_cells: Cells = timeline.cell_documents(self._planned)
        self._plans: dict[str, Cells] = {}
        self._plan_of: tuple[Cells, str] = ((), "")
        self._load = ""
        self.stopping = False

    def shown(self) -> Mapping[str, Any]:
        """Key → value; a key's value is replaced as a whole."""
        with self._turn:
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

    def plan(self, wanted: str) -> dict[str, Any]:
        """The time line of that id, with its pictures; the present one where that is none of the last."""
        return plan.plan_document(self._plans.get(wanted) or self._cells())

    def question(self) -> tuple[str, str]:
        """What the run wants a person to do and confirm, and the mark that the answer must bear; '' where nothing."""
        state = self.state() if self._live.get("pid") == self._runs.pid() else {}
        return language.sentence(state.get("confirm"), "en"), state.get("question", "")

    def view(self) -> View:
        """The state of the screen, looked up anew."""
        self._refresh()
        return self._view(self._runs.pid(), self._queue.state)

    def has_fault(self) -> bool:
        """Whether the last run ended for a reason that a person should read."""
        return bool(self._fault(self.state(), running=self._runs.pid() is not None))

    def load_id(self) -> str:
        """What names the last load, or the run that never came to one."""
        if self._never_begun():
            return f"start-{self._runs.started}"
        return f"{self._live.get('pid')}-{self._live.get('state', {}).get('began_s', 0.0):.0f}" if self._live else ""

    def units_in_progress(self) -> dict[str, str]:
        """Serial → nest of what a run was given and has not ended."""
        state = self.state() if self._live.get("pid") == self._runs.pid() else {}
        measured = {n["serial"]: n["nest"] for n in state.get("nests", ()) if not n["outcome"]}
        return measured | {w.serial: nest for nest, w in self._queue.handed.items()}

    def unfinished(self) -> dict[str, str]:
        """Nest → serial of the units of the last load that neither passed nor failed."""
        return {n["nest"]: n["serial"] for n in self.state().get("nests", ()) if n["outcome"] not in ("PASS", "FAIL")}

    def _refresh(self) -> None:
        """Reads the live file again when it is another one; a file in between keeps the last. Not while another thread
        is composing what is shown."""
        with self._turn:
            try:
                stat = self._path.stat()
                stamp = (stat.st_ino, stat.st_mtime_ns)
                if stamp != self._stamp:
                    self._live, self._stamp = self._as_logged(read_live_state(self._path)), stamp
            except FileNotFoundError:
                self._live, self._stamp = {}, None
            except (OSError, *NOT_AS_EXPECTED):
                return

    def _as_logged(self, live: dict[str, Any]) -> dict[str, Any]:
        """With verdicts only where the log does not speak against them: the file is a view, and the log the record."""
        state = live["state"]
        nests = [n if self._glance.bears_out(n) else _disowned(n) for n in state.get("nests", ())]
        return {**live, "state": {**state, "nests": nests}} if nests else live

    def _never_begun(self) -> bool:
        return self._runs.started not in (None, self._live.get("pid"))

    def _view(self, pid: int | None, queue: QueueState) -> View:
        running, state = pid is not None, self._live.get("state", {})
        mine, load = running and self._live.get("pid") == pid, self.load_id()
        facts = load_view.Facts(
            nests=[n.name for n in self._settings.nests],
            running=running,
            question=mine and bool(state.get("question")),
            instruction=mine and bool(state.get("instruction")),
            waiting={nest: w.serial for nest, w in queue.waiting.items()},
            entries=() if self._never_begun() else state.get("nests", ()),
            fault=bool(self._fault(state, running=running)),
            cleared=load in queue.cleared,
            binned=load == queue.binned,
        )
        return load_view.view_of(facts)

    def _compose(self) -> dict[str, Any]:
        pid = self._runs.pid()
        running = pid is not None
        state: dict[str, Any] = self._live.get("state", {})
        unkept = self._settle_queue(pid)
        mine = running and self._live.get("pid") == pid
        self.stopping = self.stopping and running
        queue = self._queue.state
        view, outer = self._view(pid, queue), self._outer.shown()
        self._notice_load(f"{self.load_id()} {running}")
        return {
            "view": {**asdict(view), "lamp": outer.get("lamp") or view.lamp},
            "outer": {key: outer[key] for key in ("state", "load", "loads") if key in outer},
            "held": outer.get("why") or "",
            "running": running,
            "stopping": self.stopping,
            "phase": state.get("phase", "") if mine else "begin" if running else "",
            "plan": self._plan_id(),
            "line": self._line(mine=mine),
            "instruction": state.get("instruction") if mine else None,
            "confirm": {k: state.get(k) or "" for k in ("confirm", "question")} if mine else {},
            "waiting": {nest: w.serial for nest, w in queue.waiting.items()},
            "queue": self._later_loads(queue.later),
            "done": state.get("done", 0) if mine or not running else 0,
            "total": state.get("total", 0) if mine or not running else 0,
            "bus": self._bus(mine=mine),
            "unit": self._live.get("unit", self._recipe.unit),
            "recipe": self._live.get("recipe") if mine else recipe_label(self._recipe),
            "product": self._live.get("product", "") if mine else self._recipe.product,
            "today": self._glance.today(),
            "note": (state.get("messages") or [None])[-1] if mine else None,
            "fault": self._fault(state, running=running) or unkept,
            "golden": self._golden_problem(),
            "shipping": self._shipping_problem(),
            "watch": self._watch_alerts(),
            **self._nests(state, queue, ready=view.state == "ready", running=running, mine=mine),
        }

    def _notice_load(self, load: str) -> None:
        """Another load than at the last look: what the log said of its units is asked again."""
        if load != self._load:
            self._load = load
            self._glance.forget()

    def _cells(self) -> Cells:
        """The cells of the run under way, of whichever recipe; of this page's recipe between runs."""
        if self._live.get("cells") and self._live.get("pid") == self._runs.pid():
            found: Cells = self._live["cells"]
            return found
        return self._own_cells

    def _plan_id(self) -> str:
        cells = self._cells()
        if cells is not self._plan_of[0]:
            self._plan_of = (cells, plan.plan_id(cells))
            self._plans = dict([*self._plans.items(), (self._plan_of[1], cells)][-4:])
        return self._plan_of[1]

    def _line(self, *, mine: bool) -> dict[str, Any]:
        """Where the time line is: its cell and since when, and how long each cell is expected to take."""
        same = self._live.get("recipe") == recipe_label(self._recipe)
        if mine or same:
            known: dict[str, Any] = {key: self._live[key] for key in _LINE_KEYS if key in self._live}
            if len(known.get("expected_s", ())) == len(self._cells()):
                return known if mine else {**known, "cell": -1, "warm_until_s": 0.0}
        return {"cell": -1, "expected_s": [round(c.expected_s, 2) for c in self._planned]} if not mine else {"cell": -1}

    def _settle_queue(self, pid: int | None) -> str:
        """Lets go of the units that the run has begun; '' or why that could not be kept."""
        try:
            self._queue.settle(begun=self._live.get("pid"), running=pid)
        except StoreFault as exc:
            return exc.sentence
        return ""

    def _later_loads(self, later: Sequence[str]) -> list[list[str]]:
        """The serials behind the next load, load by load."""
        each = max(1, len(self._settings.nests))
        return [list(later[i : i + each]) for i in range(0, len(later), each)]

    def _readings(self) -> Mapping[str, NestReading]:
        """Nest → what its unit sends before a run, as the listener has heard it."""
        if time.monotonic() - self._heard[0] > READINGS_POLL_S:
            self._heard = (time.monotonic(), read_readings(self._runs.order.database, time.time()))
        return self._heard[1]

    def _nests(
        self, state: Mapping[str, Any], queue: QueueState, *, ready: bool, running: bool, mine: bool
    ) -> dict[str, Any]:
        """Each nest under `nest NAME`, and its reading, which changes far more often, under `live NAME`."""
        shown: dict[str, Any] = {}
        for nest in self._settings.nests:
            there = self._nest(nest.name, state, queue, running=running, mine=mine)
            vector = there.pop("vector", None) or ()
            there.pop("noise", None)
            live = vector if running and not there.get("outcome") else ()
            heard = self._readings().get(nest.name) if ready else None
            if heard is not None and heard.serial == there["serial"]:
                live = (*heard.vector[:3], *([] if heard.temperature_degC is None else [heard.temperature_degC]))
            shown |= {f"nest {nest.name}": there, f"live {nest.name}": [round(float(v), _DECIMALS) for v in live]}
        return shown

    def _nest(
        self, name: str, state: Mapping[str, Any], queue: QueueState, *, running: bool, mine: bool
    ) -> dict[str, Any]:
        """What is in a nest, and what comes next. Verdicts stay until somebody has dealt with the load; what was
        scanned meanwhile waits as `next`, because the other unit is still in the nest."""
        waits, handed = queue.serial_of(name), queue.handed.get(name)
        entry = next((n for n in state.get("nests", ()) if n["nest"] == name), None)
        if self._never_begun() or (not running and self.load_id() in queue.cleared):
            entry = None
        if running and not mine:
            there = {"serial": handed.serial if handed else "", "scanned": handed is not None}
        elif not running and entry is None:
            return self._with_past({"serial": waits, "scanned": bool(waits), "next": ""})
        else:
            there = {**(entry or {"serial": ""}), "scanned": False}
        return self._with_past({**there, "next": waits})

    def _with_past(self, there: dict[str, Any]) -> dict[str, Any]:
        """With the attempts of this unit before the present one."""
        past = self._glance.previous(there["serial"]) if there["serial"] and not there.get("outcome") else {}
        return {**there, "attempts": past.get("attempts", 0), "last": past if past.get("reason") else None}

    def _fault(self, state: Mapping[str, Any], *, running: bool) -> Mapping[str, Any] | str:
        """Why there is no run, where it did not end by itself."""
        if running:
            return ""
        if self._never_begun():
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

    def _shipping_problem(self) -> Mapping[str, Any] | str:
        """Which plant has refused a record or has been away, and since when; '' when all is well."""
        at_s, problem = self._shipping
        if time.monotonic() - at_s > SHIPPING_POLL_S:
            found = read_statuses(self._runs.order.database) if self._settings.receivers else []
            held = [sentence_of(s) for s in found if s.state in (ShippingState.PARKED, ShippingState.AWAY)]
            problem = Message("shipping-held", plants=held).document() if held else ""
            self._shipping = (time.monotonic(), problem)
        return problem

    def _watch_alerts(self) -> Mapping[str, Any] | str:
        """What the watch has found and is not put right; '' when all is well."""
        at_s, alerts = self._watched
        if time.monotonic() - at_s > WATCH_POLL_S:
            standing = read_book(self._runs.order.database).standing() if self._settings.alerts else []
            alerts = Message("watch-standing", alerts=standing).document() if standing else ""
            self._watched = (time.monotonic(), alerts)
        return alerts

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


def _disowned(nest: Mapping[str, Any]) -> dict[str, Any]:
    """A nest whose verdict the log does not have: its unit counts as not measured."""
    why = Message("verdict-not-logged", serial=nest["serial"], outcome=nest["outcome"])
    return {**nest, "outcome": "ERROR", "figure": None, "reasons": [why.document()]}
