"""Alerts of the watch on their way: into the book beside the log, from there to channels, page and the log itself."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from station.adapters.alert_channels.mail import Mail, MailAccount
from station.adapters.alert_channels.webhook import Webhook
from station.adapters.clock import SystemClock
from station.config.settings import AlertSettings, MailSettings, Settings
from station.errors import ConfigError
from station.files.json_text import NOT_AS_EXPECTED, read_json
from station.files.owner import OwnerLock
from station.files.replace import replace_text
from station.files.system_errors import os_error_reason
from station.messages import Message
from station.panel_protocol.companion import Companion, companion_file
from station.ports.alerts import AlertChannel
from station.service.alerts import AlertBook, ReportedFinding
from station.service.watch import Finding, Watch
from station.service.watch_report import (
    alert_document,
    alert_remarks,
    alert_remedy,
    alert_sentence,
)
from station.wiring.beside import running_beside
from station.wiring.logs import plant_address

#: How long a channel rests that could not be reached, first and at most, s.
FIRST_BACK_OFF_S, LAST_BACK_OFF_S = 30.0, 3600.0
#: A plant's book lies in the folder in which its watch runs.
_PLANT_LOG = Path("plant")


def alert_book_path(database: Path) -> Path:
    """Where the book of a log's alerts is."""
    return companion_file(_PLANT_LOG if plant_address(database) else database, Companion.ALERTS)


def read_book(database: Path) -> AlertBook:
    """The book as it was last kept; an empty one where there is none, or none that can be read."""
    try:
        return AlertBook.of(read_json(alert_book_path(database)))
    except (OSError, *NOT_AS_EXPECTED):
        return AlertBook()


def channels_of(settings: AlertSettings) -> list[AlertChannel]:
    """The channels of config.yaml. Errors: ConfigError."""
    found: list[AlertChannel] = [Webhook(url) for url in settings.webhooks]
    if settings.mail is not None:
        found.append(Mail(_account(settings.mail), settings.mail.sender, settings.mail.to))
    return found


class AlertDesk:
    """One process tells the alerts of a log. Errors: StoreFault where another one does; ConfigError."""

    def __init__(self, database: Path, settings: AlertSettings, owner: str) -> None:
        self._database, self._clock = database, SystemClock()
        lock = alert_book_path(database).with_suffix(".lock")
        self._lock = OwnerLock(lock, Message("owned-watch", path=str(database)), owner, self._clock.epoch_ns())
        self._channels = {channel.name: channel for channel in channels_of(settings)}
        self._run_length = settings.run_length
        self._book = read_book(database)
        self._rest_s: Mapping[str, tuple[float, float]] = {}

    def close(self) -> None:
        """Lets another process tell them."""
        self._lock.release()

    def update(self, watch: Watch) -> None:
        """Enters what the loads so far say, and keeps the book."""

        def report(finding: Finding) -> ReportedFinding:
            units = watch.touched(finding)
            text = [alert_sentence(finding, len(units)), *alert_remarks(finding)]
            text.append(alert_remedy(finding.alert.place.signal.kind))
            return ReportedFinding(alert_document(finding, units, self._run_length), text)

        self._book.update(watch.findings(), report, list(self._channels), self._clock.epoch_ns())
        self._keep()

    def deliver(self) -> None:
        """Sends what waits; a channel that fails is tried again later, and holds up no other."""
        now_s = self._clock.monotonic_s()
        for name, channel in self._channels.items():
            until_s, rest_s = self._rest_s.get(name, (0.0, FIRST_BACK_OFF_S))
            if now_s < until_s:
                continue
            try:
                for entry in self._book.pending(name):
                    channel.send({key: value for key, value in entry.items() if key != "pending"})
                    self._book.delivered(entry, name)
                    self._keep()
                self._rest_s = {**self._rest_s, name: (0.0, FIRST_BACK_OFF_S)}
            except OSError:
                longer_s = min(2 * rest_s, LAST_BACK_OFF_S)
                self._rest_s = {**self._rest_s, name: (now_s + rest_s, longer_s)}

    def _keep(self) -> None:
        with suppress(OSError):  # a full disk stops no watch; what is in memory is still delivered
            text = json.dumps(self._book.document(), ensure_ascii=False)
            replace_text(alert_book_path(self._database), text, durable=True)


@contextmanager
def watching_in_background(database: Path, config: Path | None, settings: Settings) -> Iterator[None]:
    """While the block lasts, another process watches the log, where config.yaml says where alerts go.

    A process of its own, so that going over a long log takes nothing from the page; where one watches already, it ends
    by itself.
    """
    if settings.alerts is None:
        yield
        return
    words = ["-m", "station", "watch", "--follow", "--db", str(database)]
    words += ["--config", str(config)] if config else []
    with running_beside(*words):
        yield


def _account(mail: MailSettings) -> MailAccount:
    password = ""
    if mail.password_file:
        try:
            password = Path(mail.password_file).read_text(encoding="utf-8").strip()
        except (OSError, ValueError) as error:
            reason = os_error_reason(error) if isinstance(error, OSError) else Message.text(str(error))
            raise ConfigError("alerts-password", file=mail.password_file, reason=reason) from error
    return MailAccount(mail.host, mail.port, mail.security, mail.user, password)
