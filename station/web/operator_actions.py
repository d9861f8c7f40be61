"""What a person may do at the operator's page; each deed stands in the journal before it is done."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from station.domain.recipe import serial as serials_of
from station.domain.records.stored_attempt import utc
from station.errors import StoreFault, UsageError
from station.messages import system_reason
from station.panel_protocol.accounts import Account
from station.panel_protocol.answer import write_answer
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.queue import WaitingUnit
from station.ports.log_reader import Attempt, Query
from station.service import golden_register
from station.web.panel import Panel

LONGEST_REASON = 200
#: So many loads may wait behind the next one.
LOADS_LATER = 3


@dataclass(frozen=True, slots=True)
class ActionForm:
    """What the form says: serial, the mark of the question that is confirmed, why a unit is taken again."""

    serial: str = ""
    question: str = ""
    reason: str = ""


class PassedAlready(UsageError):
    """The unit has passed this recipe; an engineer may take it again on purpose."""


def scan(panel: Panel, who: Account, form: ActionForm) -> str:
    """The serial goes to the first nest that is free in the next load; where none is, to the loads after it. One that
    waits there is brought forward into a free nest."""
    nest = _free_nest(panel)
    if not (nest and form.serial in panel.queue.later):
        _check_fits_load(panel, form.serial)
    passed = _newest_pass(panel, form.serial)
    if passed is not None:
        raise PassedAlready(
            "scan-passed-already",
            serial=form.serial,
            recipe=passed.recipe_name,
            day=utc(passed.started_ns)[:10],
            nest=passed.nest,
        )
    _check_room(panel, nest)
    _clear_finished_load(panel)
    panel.journal.add(who.name, "scan", serial=form.serial, **({"nest": nest} if nest else {}))
    return _queue(panel, form.serial, nest)


def take_again(panel: Panel, who: Account, form: ActionForm) -> str:
    """A unit that passed is taken once more, by an engineer's choice and with the reason."""
    if not who.may("again"):
        raise UsageError("repeat-not-allowed", role=who.role.value)
    if not 3 <= len(form.reason) <= LONGEST_REASON or not form.reason.isprintable():
        raise UsageError("repeat-reason-length", limit=LONGEST_REASON)
    _check_fits_load(panel, form.serial)
    passed, nest = _newest_pass(panel, form.serial), _free_nest(panel)
    _check_room(panel, nest)
    of = passed.attempt if passed else ""
    panel.journal.add(who.name, "again", serial=form.serial, nest=nest, reason=form.reason, passed=of)
    return _queue(panel, form.serial, nest)


def take_out(panel: Panel, who: Account, form: ActionForm) -> str:
    """One unit that waits is taken out of its nest again."""
    if form.serial not in panel.queue.serials():
        raise UsageError("take-out-not-waiting", serial=form.serial[:40])
    panel.journal.add(who.name, "take-out", serial=form.serial)
    panel.queue.take_out(form.serial)
    return form.serial


def acknowledge_load(panel: Panel, who: Account, _form: ActionForm) -> str:
    """The failed units of the last load are in the red bin; or, of a load without any, it has been dealt with."""
    _check_idle(panel)
    view, load = panel.screen.view(), panel.screen.load_id()
    if view.state not in ("done", "act"):
        raise UsageError("acknowledge-nothing")
    serials = [n["serial"] for n in panel.screen.state().get("nests", ()) if n["nest"] in view.bin]
    panel.journal.add(who.name, "acknowledge", red_bin=serials)
    panel.queue.acknowledge(load, all_done=view.why == "fault" or not panel.screen.has_fault())
    return ", ".join(view.bin)


def clear(panel: Panel, who: Account, _form: ActionForm) -> str:
    """Nothing waits for the start any more."""
    panel.journal.add(who.name, "clear", serials=panel.queue.serials())
    panel.queue.clear()
    return ""


def resume(panel: Panel, who: Account, _form: ActionForm) -> str:
    """The units of the last load that came to no verdict are taken up again, each in its nest; those of the next load
    wait until they are done."""
    _check_idle(panel)
    unfinished = panel.screen.unfinished()
    if not unfinished:
        raise UsageError("take-up-nothing")
    serials_of.check_all(list(unfinished.values()), panel.recipe)
    _clear_finished_load(panel)
    panel.journal.add(who.name, "resume", serials=list(unfinished.values()))
    panel.queue.put({nest: WaitingUnit(serial) for nest, serial in unfinished.items()})
    return ", ".join(unfinished.values())


def start(panel: Panel, who: Account, _form: ActionForm) -> str:
    """Every unit that waits goes to a run of its own process, each in its nest."""
    _check_idle(panel)
    waiting = panel.queue.waiting
    units = {n.name: waiting[n.name].serial for n in panel.settings.nests if n.name in waiting}
    if not units:
        raise UsageError("start-without-units")
    serials_of.check_all(list(units.values()), panel.recipe)
    _check_binned(panel)
    _clear_finished_load(panel)
    panel.journal.add(who.name, "start", serials=list(units.values()), recipe=panel.order.recipe)
    panel.queue.hand_over(panel.runs.start(units, who.name), [n.name for n in panel.settings.nests])
    return ", ".join(units.values())


def stop(panel: Panel, who: Account, _form: ActionForm) -> str:
    """The run stops at the next safe place and parks."""
    pid = panel.runs.stop()
    panel.screen.stopping = True
    panel.journal.add(who.name, "stop", pid=pid)
    return ""


def confirm(panel: Panel, who: Account, form: ActionForm) -> str:
    """What the run asked a person to do is done; an old screen cannot confirm a later question."""
    question, mark = panel.screen.question()
    if not mark or form.question != mark:
        raise UsageError("confirm-outdated")
    panel.journal.add(who.name, "confirm", sentence=question)
    try:
        write_answer(panel.order.database, mark)
    except OSError as exc:
        file = companion_file(panel.order.database, Companion.ANSWER)
        raise StoreFault("file-not-written", file=str(file), why=system_reason(exc)) from exc
    return ""


def _check_binned(panel: Panel) -> None:
    """UsageError while failed units of the last load may still lie in their nests."""
    view = panel.screen.view()
    if view.bin:
        raise UsageError("start-before-red-bin", nests=view.bin)


def _clear_finished_load(panel: Panel) -> None:
    """Whoever goes on with other units has dealt with a load that left nothing for the red bin."""
    view = panel.screen.view()
    if view.state in ("done", "act") and not view.bin and panel.runs.pid() is None:
        panel.queue.acknowledge(panel.screen.load_id(), all_done=True)


def _check_fits_load(panel: Panel, serial: str) -> None:
    """UsageError for a serial that is none of the recipe's, waits already, or is being measured."""
    serials_of.check_all([*panel.queue.serials(), serial], panel.recipe)
    nest = panel.screen.units_in_progress().get(serial)
    if nest is not None:
        raise UsageError("scan-in-progress", serial=serial, nest=nest)


def _free_nest(panel: Panel) -> str:
    """The nest whose unit is scanned next; '' where the next load is full."""
    waiting = panel.queue.waiting
    return next((n.name for n in panel.settings.nests if n.name not in waiting), "")


def _check_room(panel: Panel, nest: str) -> None:
    """Errors: UsageError where there is no free nest, and no place behind the next load."""
    room = LOADS_LATER * len(panel.settings.nests)
    if not nest and len(panel.queue.later) >= room:
        raise UsageError("scan-queue-full", count=room)


def _queue(panel: Panel, serial: str, nest: str) -> str:
    """Puts the serial into the nest, or behind the next load where it has none; what the screen says of it."""
    if not nest:
        panel.queue.append(serial)
        return serial
    panel.queue.put({nest: WaitingUnit(serial)})
    return f"{serial}: {nest}"


def _newest_pass(panel: Panel, serial: str) -> Attempt | None:
    """The unit's newest PASS with this recipe; golden units are there to be measured again and again."""
    register = panel.settings.golden
    if (
        register is not None and serial in golden_register.load(Path(register.file))
    ) or not panel.order.database.exists():
        return None
    with panel.log() as log:
        found = log.attempts(Query(serial=serial, recipe_name=panel.recipe.name, outcome="PASS"), 1)
    return found[0] if found else None


def _check_idle(panel: Panel) -> None:
    if panel.runs.pid() is not None:
        raise UsageError("run-under-way")


ACTIONS: Mapping[str, Callable[[Panel, Account, ActionForm], str]] = {
    "scan": scan,
    "again": take_again,
    "take-out": take_out,
    "acknowledge": acknowledge_load,
    "clear": clear,
    "resume": resume,
    "start": start,
    "stop": stop,
    "confirm": confirm,
}
