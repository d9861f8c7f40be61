"""The work of `station golden`."""

import time
from dataclasses import asdict, dataclass, replace
from datetime import date
from functools import partial
from pathlib import Path

from station.cli import _output
from station.cli._golden_trend import show_trend
from station.config.recipes import load_recipe
from station.config.settings import load_settings
from station.domain.line_quality.golden import RegisteredUnit
from station.domain.recipe.serial import canonical, check
from station.domain.records.stored_attempt import utc_day
from station.errors import ConfigError, ReferenceOverdue, UsageError
from station.messages import Message
from station.service import golden_register
from station.wiring.logs import find_log, open_log

#: Half-width of a value that a unit's own run came to, as a share of the recipe's limit.
_SHARE = 0.1


@dataclass(frozen=True, slots=True)
class RegisterOptions:
    """Options of `register`; recipe: whose serials these are, '' for config.yaml's; svg: of `trend`."""

    bad: bool
    within: float | None
    due: str
    values: tuple[str, ...] = ()
    recipe: str = ""
    svg: Path | None = None


def manage_golden_units(
    action: str, serial: str | None, options: RegisterOptions, where: tuple[Path | None, Path | None], *, as_json: bool
) -> int:
    """Does what is asked; where: log and config. Errors: UsageError, ConfigError, LogError."""
    db, config = where
    settings = load_settings(config)
    if settings.golden is None:
        raise ConfigError("golden-not-configured")
    database, register = db or Path(settings.database), Path(settings.golden.file)
    units = golden_register.load(register)
    if action == "trend":
        chosen = _registered(units, serial, action)
        with open_log(database) as log:
            return show_trend(log, chosen, options.svg, as_json=as_json)
    if action in ("register", "remove"):
        filled = replace(options, recipe=options.recipe or settings.recipe)
        _update_register(units, action, serial, filled, database)
        golden_register.save(register, units)
    elif action not in ("check", "list"):
        raise UsageError("golden-unknown-action", action=action[:20])
    elif serial is not None:
        raise UsageError("golden-of-all", action=action, serial=serial[:40])
    standings = golden_register.standings(settings, partial(find_log, database))
    if as_json:
        document = {"schema": golden_register.SCHEMA, "units": [asdict(u) for u in units.values()]}
        _output.print_json({**document, "standings": [asdict(s) for s in standings]})
    else:
        for s in standings:
            _output.print_line(f"{s.serial} ({s.kind}): {s.problem or 'as registered'}")
    problem = any(s.problem for s in standings) or not standings
    return ReferenceOverdue.exit_code if action == "check" and problem else 0


def _update_register(
    units: dict[str, RegisteredUnit], action: str, serial: str | None, options: RegisterOptions, database: Path
) -> None:
    if serial is None:
        raise UsageError("golden-without-serial", action=action)
    if action == "register":
        _refuse_other_spelling(units, serial)
    if action == "register" and options.values:
        _refuse_with_values(options)
        check(serial, load_recipe(options.recipe))
        units[serial] = golden_register.by_certificate(serial, options.values, _parse_due(options.due))
    elif action == "register":
        with open_log(database) as log:
            share = _SHARE if options.within is None else options.within
            due = _parse_due(options.due)
            units[serial] = golden_register.expect(log, serial, bad=options.bad, share=share, due=due)
    else:
        del units[_registered(units, serial, action).serial]


def _refuse_with_values(options: RegisterOptions) -> None:
    """UsageError for what only a registration by the unit's own run reads."""
    for option, given in (("--bad", options.bad), ("--within", options.within is not None)):
        if given:
            raise UsageError("option-wrong", option=option, reason=Message("golden-by-values"))


def _refuse_other_spelling(units: dict[str, RegisteredUnit], serial: str) -> None:
    """UsageError where a registered unit is this one by its device number, spelt otherwise."""
    for other in units:
        if other != serial and canonical(other) == canonical(serial):
            raise UsageError("serial-spelt-twice", serial=serial, other=other)


def _registered(units: dict[str, RegisteredUnit], serial: str | None, action: str) -> RegisteredUnit:
    if serial is None:
        raise UsageError("golden-without-serial", action=action)
    if serial not in units:
        raise UsageError("golden-not-registered", serial=serial, serials=tuple(units))
    return units[serial]


def _parse_day(text: str) -> str:
    if not text:
        return ""
    try:
        return date.fromisoformat(text).isoformat()
    except ValueError as exc:
        raise UsageError("option-not-a-day", option="--due", text=text[:20]) from exc


def _parse_due(text: str) -> str:
    """A day that is still to come, or ''. Errors: UsageError."""
    day, today = _parse_day(text), utc_day(time.time_ns())
    if day and day < today:
        raise UsageError("golden-due-past", due=day, today=today)
    return day
