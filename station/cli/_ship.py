"""The face of shipping."""

import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from threading import Event

from station.cli import _output
from station.config.settings import Settings, load_settings
from station.errors import ConfigError
from station.messages import Message, render
from station.service.shipping import SCHEMA, ShippingState, ShippingStatus, sentence_of
from station.wiring.logs import open_log
from station.wiring.shipping import Shipping, read_statuses

_EXIT_CODES = {ShippingState.AWAY: 3, ShippingState.PARKED: 1}
#: What --once waits for at most beyond any single time-out, s.
_ONCE_S = 7 * 24 * 3600.0
#: So often the bars go on, s.
_SHOWN_EVERY_S = 0.5


def ship(db: Path | None, config: Path | None, *, once: bool, as_json: bool) -> int:
    """Ships until it is stopped; once: until each plant has everything or cannot take it.

    Errors: ConfigError, LogError.
    """
    settings, database = _station(db, config)
    if not settings.receivers:
        raise ConfigError("shipping-no-receivers")
    if database.exists():  # a log that is yet to be made is waited for; another file never becomes one
        open_log(database).close()
    shipping = Shipping(database, settings)
    shipping.start()
    try:
        if once:
            _wait(shipping)
        else:
            with suppress(KeyboardInterrupt):  # Ctrl-C is the way to stop it, and no failure
                for receiver in settings.receivers:
                    _output.print_remark(render(Message("shipping-to", path=str(database), url=receiver.url)))
                Event().wait()
            return 0
    finally:
        shipping.stop()
    return _show(shipping.statuses(), as_json=as_json)


def _wait(shipping: Shipping) -> None:
    """Until each plant has everything or cannot take it; a bar a plant."""
    until_s = time.monotonic() + _ONCE_S
    with _output.progress() as bar:
        tasks = {
            s.receiver: bar.add_task(render(Message("activity-shipping", receiver=s.receiver)), total=None)
            for s in shipping.statuses()
        }
        while not shipping.wait_until_settled(min(until_s, time.monotonic() + _SHOWN_EVERY_S)):
            for s in shipping.statuses():
                bar.update(tasks[s.receiver], completed=s.number, total=s.newest or None)
            if time.monotonic() >= until_s:
                return


def show_status(db: Path | None, config: Path | None, *, as_json: bool) -> int:
    """How far each plant has the log, as whoever ships said last."""
    return _show(read_statuses(_station(db, config)[1]), as_json=as_json)


def _station(db: Path | None, config: Path | None) -> tuple[Settings, Path]:
    settings = load_settings(config)
    return settings, db or Path(settings.database)


def _show(statuses: Sequence[ShippingStatus], *, as_json: bool) -> int:
    if as_json:
        _output.print_json({"schema": SCHEMA, "receivers": [s.document() for s in statuses]})
    for s in () if as_json else statuses:
        _output.print_message(sentence_of(s))
    return max((_EXIT_CODES.get(s.state, 0) for s in statuses), default=0)
