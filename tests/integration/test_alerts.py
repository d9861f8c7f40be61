"""An alert of the watch reaches webhook, mail, page and log once, with its end, whatever restarts or fails."""

import json
import shutil
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.config.settings import AlertSettings, MailSettings, load_settings
from station.errors import ConfigError, StoreFault
from station.messages import Message, render
from station.service.alerts import AlertBook, ReportedFinding, record_alerts
from station.service.watch import Finding, Watch
from station.web.panel import Panel
from station.web.run_launcher import LaunchOptions
from station.wiring import alerts
from station.wiring.alerts import AlertDesk, read_book, watching_in_background
from station.wiring.jobs import load_job
from tests.fakes import watched_log
from tests.fakes.receivers import HookServer, MailServer, serving

SEED, BEGIN, RIGHTED, LAST = 5, 61, 81, 100


def tilted(load: int, nest: str) -> tuple[float, float, float]:
    """Nest B stands askew by 2 mrad about its x for twenty loads."""
    return (2e-3 if nest == "B" and BEGIN <= load < RIGHTED else 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def worn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("worn")
    watched_log.write(made / "station.db", range(1, RIGHTED), tilted, SEED)
    return made


@pytest.fixture
def path(worn: Path, tmp_path: Path) -> Path:
    """A copy for each test."""
    shutil.copytree(worn, tmp_path, dirs_exist_ok=True)
    return tmp_path / "station.db"


@pytest.fixture
def receivers() -> Iterator[tuple[HookServer, MailServer]]:
    hook, mail = HookServer(), MailServer()
    with serving(hook, mail):
        yield hook, mail


def settings_of(hook: HookServer, mail: MailServer) -> AlertSettings:
    port = int(mail.server_address[1])
    people = ("ada@plant.example", "bo@plant.example")
    account = MailSettings(host="127.0.0.1", port=port, security="none", sender="watch@plant.example", to=people)
    return AlertSettings(webhooks=(hook.url,), mail=account)


def tell(path: Path, settings: AlertSettings) -> None:
    """One look of a process that watches, from its start to its end."""
    desk = AlertDesk(path, settings, "bench-1")
    with SqliteLogReader(path) as log:
        watch = Watch(log, settings.run_length)
        watch.read()
        desk.update(watch)
        desk.deliver()
    desk.close()


def test_only_what_is_new_of_an_alert_is_reported(path: Path) -> None:
    """To report is to list every unit touched: not again of each alert that ever was, after each load."""
    book, reported = AlertBook(), list[Finding]()

    def report(finding: Finding) -> ReportedFinding:
        reported.append(finding)
        return ReportedFinding({}, [Message.text("tilted")])

    with SqliteLogReader(path) as log:
        watch = Watch(log, 1000)
        watch.read()
        for _ in range(3):
            book.update(watch.findings(), report, [], 0)
    assert len(reported) == len(book.entries) == 1


def test_an_alert_and_its_end_reach_everybody_once(path: Path, receivers: tuple[HookServer, MailServer]) -> None:
    hook, mail = receivers
    settings = settings_of(hook, mail)
    hook.broken = True
    tell(path, settings)
    assert (hook.bodies, len(mail.mails)) == ([], 1), "one channel that is out of order holds up no other"
    hook.broken = False
    for _ in range(2):  # another process each time
        tell(path, settings)
    ((body,), (people, letter)) = hook.bodies, mail.mails[0]
    assert (body["schema"], body["what"], body["alert"]["effect"]) == ("station.alert/1", "raised", "nest-tilt")
    assert (body["alert"]["nest"], body["alert"]["station"]) == ("B", "bench-1")
    assert "token" not in json.dumps([body, read_book(path).document()])
    assert people == ["ada@plant.example", "bo@plant.example"]
    assert letter["Subject"].startswith("[bench-1] Nest B of bench-1 tilts by")
    assert "clean the seat" in str(letter.get_payload(0))
    assert [render(message) for message in read_book(path).standing()] == [body["text"][0]]
    watched_log.write(path, range(RIGHTED, LAST + 1), tilted, SEED)
    tell(path, settings)
    assert [b["what"] for b in hook.bodies] == ["raised", "ended"]
    assert any("Put right with load" in line for line in hook.bodies[1]["text"])
    assert len(mail.mails) == 2
    assert read_book(path).standing() == []


def test_the_log_holds_each_alert_once_whoever_records_it(path: Path, receivers: tuple[HookServer, MailServer]) -> None:
    tell(path, settings_of(*receivers))
    for _ in range(2):
        with SqliteStore(path, "bench-1") as store:
            record_alerts(store, read_book(path))
    with SqliteLogReader(path) as log:
        (event,) = log.station_events("watch-alert", 10)
        assert list(log.findings()) == []
    assert json.loads(event.detail)["alert"]["nest"] == "B"


def test_the_page_starts_a_watch_and_shows_what_lasts(path: Path, receivers: tuple[HookServer, MailServer]) -> None:
    config = path.with_name("config.yaml")
    config.write_text(
        "schema: station.config/1\nstation: bench-1\nnests: [{name: A, node: 17}, {name: B, node: 18}]\n"
        f"database: {path}\nalerts: {{webhooks: ['{receivers[0].url}']}}\n",
        encoding="utf-8",
    )
    settings = load_settings(config)
    with watching_in_background(path, config, settings):
        until = time.monotonic() + 60
        while not receivers[0].bodies and time.monotonic() < until:
            threading.Event().wait(0.05)
    options = LaunchOptions(path, "six-point", config, simulate=True)
    panel = Panel(settings, load_job("six-point")[0].recipe, options, path.with_name("accounts.json"))
    shown = render(Message.of(panel.screen.shown()["watch"]))
    assert shown == receivers[0].bodies[0]["text"][0]
    assert shown.startswith("Nest B of bench-1 tilts by")


def test_what_ended_before_the_book_was_begun_is_nobodys_news(
    path: Path, receivers: tuple[HookServer, MailServer]
) -> None:
    watched_log.write(path, range(RIGHTED, LAST + 1), tilted, SEED)
    tell(path, settings_of(*receivers))
    assert (receivers[0].bodies, receivers[1].mails) == ([], [])


def test_a_drift_tells_when_it_meets_its_limit(
    path: Path, receivers: tuple[HookServer, MailServer], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The forecast comes once, when the limit comes in sight, with the load and the hour."""
    hook = receivers[0]
    settings = settings_of(*receivers)
    tell(path, settings)
    with SqliteLogReader(path) as log:
        watch = Watch(log, settings.run_length)
        watch.read()
        (finding,) = watch.findings()
    limited = finding.recipe.model_copy(update={"limits": finding.recipe.limits.model_copy(update={"tilt_deg": 0.5})})
    (first, *others) = finding.alert.changes
    drifting = replace(first, slope=5e-5, slope_std=1e-6)
    finding.alert.changes = (drifting, *others)
    seen = replace(finding, recipe=limited)
    monkeypatch.setattr(Watch, "findings", lambda self: [seen])
    for _ in range(2):
        tell(path, settings)
    assert [b["what"] for b in hook.bodies] == ["raised", "forecast"]
    drift = hook.bodies[1]["alert"]["drift"]
    # From the newest load's level to half a degree, a step of 50 µrad a load, a load a minute.
    room = (0.5 * 3.141592653589793 / 180) / 5e-5 - (RIGHTED - finding.alert.begin)
    assert drift["loads_to_limit"] == pytest.approx(room, abs=1.0)
    assert drift["meets_limit_at"].startswith("2026-01-01T0")
    assert any("meets the recipe's limit in" in line for line in hook.bodies[1]["text"])


def test_one_process_tells_and_a_missing_password_is_a_sentence(
    path: Path, receivers: tuple[HookServer, MailServer]
) -> None:
    settings = settings_of(*receivers)
    desk = AlertDesk(path, settings, "bench-1")
    with pytest.raises(StoreFault, match="The watch of"):
        AlertDesk(path, settings, "bench-1")
    desk.close()
    assert settings.mail is not None
    mail = settings.mail.model_copy(update={"password_file": str(path.with_name("none"))})
    with pytest.raises(ConfigError, match="password_file"):
        alerts.channels_of(settings.model_copy(update={"mail": mail}))
