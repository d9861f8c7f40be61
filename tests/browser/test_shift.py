"""An operator's shift in a real browser: log in, scan four, one fails, stop in the middle, reload, take up again."""

import json
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from station.adapters.store.reader import SqliteLogReader
from station.panel_protocol.journal import Journal
from station.ports.log_reader import Query
from tests.browser.chrome import Browser
from tests.browser.conftest import Site
from tests.browser.judge import SCREENS, judged
from tests.fakes import fixture_run

Serve = Callable[..., Site]
LogIn = Callable[..., Browser]
pytestmark = pytest.mark.timeout(240)
F2 = "\ue032"
#: A unit is turned by hand between two runs.
TURNED = {"axis": [0, 0, 1], "angle_deg": 180}
RUNS = [{"seating": "home", "order": "listed"}, {"seating": "turned", "order": "reversed"}]


def verdict(nest: str) -> str:
    """JavaScript: what stands as a nest's verdict."""
    return f"document.querySelector('[data-nest={nest}] [data-part=verdict]').dataset.outcome"


def scan(page: Browser, *serials: str) -> None:
    """Types as a scanner does, and waits until each stands in its nest."""
    for serial in serials:
        page.keys(f"{serial}\n")
        page.wait(f"[...document.querySelectorAll('[data-part=serial]')].some(n => n.textContent === '{serial}')")


def state(page: Browser, name: str, limit_s: float = 20.0) -> None:
    """Waits until the screen is in that state; a key that comes sooner than half a second later is no answer."""
    page.wait(f"document.body.dataset.state === '{name}'", limit_s)


def press(page: Browser, limit_s: float = 20.0) -> None:
    """Presses the one large button, once it counts."""
    page.wait("document.querySelector('#primary')", limit_s)
    page.later("setTimeout(arguments[0], 300)")
    page.click("#primary")


def test_a_shift(serve: Serve, log_in: LogIn, pictures: Path) -> None:
    site = serve("--pace", "8", "--fault", "SN0002/stuck-axis:value=2")
    page = log_in(site)
    page.wait("document.activeElement.id === 'scan'")
    page.keys("nonsense\n")
    page.wait("document.querySelector('#told').textContent.includes('does not match')")
    scan(page, "SN0001", "SN0002", "SN0003", "SN0004")
    page.keys("SN0001\n")
    page.wait("document.querySelector('#told').textContent.includes('listed twice')")
    state(page, "ready")
    press(page)
    page.wait("document.querySelector('#stop')", 20)
    page.script("document.querySelector('#stop').dataset.first = 'yes'")
    # One fails early, with its reason; the others go on.
    page.wait(f"{verdict('B')} === 'FAIL'", 60)
    page.wait("document.querySelector('.pose svg') && document.querySelector('.following svg')", 20)
    assert "FAIL" in page.text("[data-nest=B] .verdict")
    assert len(page.text("[data-nest=B] .why")) > 10
    page.wait("document.querySelector('[data-nest=A] .live').textContent.includes(' g')", 20)
    page.picture(pictures / "operator.png")
    # Positions went by, and Stop is still the same button: a press in that instant is not lost.
    assert page.script("return document.querySelector('#stop').dataset.first === 'yes'")
    # Reload in the middle: within a second the page knows as much as before.
    page.go(site.url)
    page.wait(f"{verdict('B')} === 'FAIL' && document.body.dataset.running === 'true'", 1.0)
    # Stop acts when it is pressed; nobody has to let go first.
    page.hold("#stop")
    page.wait(f"{verdict('A')} === 'ABORTED' && document.body.dataset.running === 'false'", 20)
    assert "STOPPED" in page.text("[data-nest=A] .verdict")
    page.go(site.url)
    page.wait(f"{verdict('A')} === 'ABORTED'", 1.0)
    # First the failed unit goes into the red bin; then what came to no verdict is taken up again.
    assert "Remove B" in page.text("#task")
    press(page)
    state(page, "act")
    assert "Stopped by" in page.text("#fault")
    press(page)
    state(page, "scan")
    assert page.script("return document.querySelector('[data-nest=B] [data-part=serial]') === null")
    page.click("#start")
    page.wait("document.body.dataset.running === 'true'", 20)
    state(page, "done", 90)
    assert page.script("return document.querySelectorAll('.nest[data-outcome=PASS]').length") == 3
    assert "3 passed" in page.text("#task")
    page.picture(pictures / "done.png")
    with SqliteLogReader(site.database) as log:
        attempts = log.attempts(Query())
    assert {a.operator for a in attempts} == {"olga"}
    ended = sorted((a.serial, a.outcome) for a in attempts)
    passed = [(s, "PASS") for s in ("SN0001", "SN0003", "SN0004")]
    aborted = [(s, "ABORTED") for s in ("SN0001", "SN0003", "SN0004")]
    assert ended == sorted([*passed, *aborted, ("SN0002", "FAIL")])
    lines = list(Journal(Path(f"{site.database}.panel.jsonl")).lines())
    assert {line["person"] for line in lines} == {"olga"}
    actions = [line["deed"] for line in lines]
    assert actions == ["log-in", *["scan"] * 4, "start", "stop", "acknowledge", "resume", "start"]


def test_the_keyboard_alone_does_it(serve: Serve, log_in: LogIn) -> None:
    page = log_in(serve("--pace", "30"))
    page.wait("document.activeElement.id === 'scan'")
    scan(page, "SN0001", "SN0002")
    tab = "\ue004"
    page.wait("document.querySelector('#start')")
    page.later("setTimeout(arguments[0], 600)")
    page.keys("START\n")
    page.wait("document.body.dataset.running === 'true'", 20)
    # The scanner fills the next load during the run, wherever the focus is; its Enter presses nothing.
    page.keys(tab)
    page.keys("SN0004\n")
    page.wait("document.querySelector('[data-nest=A] [data-part=next]').textContent === 'SN0004'", 20)
    state(page, "done", 60)
    assert page.script("return document.querySelectorAll('.nest[data-outcome=PASS]').length") == 2
    page.later("setTimeout(arguments[0], 600)")
    page.keys(F2)
    state(page, "scan")
    page.keys(tab * 3)
    scan(page, "SN0003")


def test_an_operator_turns_the_units_by_hand_and_scans_the_next_load(
    serve: Serve, log_in: LogIn, tmp_path: Path, pictures: Path, axe: str
) -> None:
    recipe = fixture_run.recipe(tmp_path, seatings={"turned": TURNED}, runs=RUNS)
    page = log_in(serve("--pace", "40", "--recipe", recipe), language="de")
    page.wait("document.activeElement.id === 'scan'")
    scan(page, "SN0001", "SN0002")
    page.click("#start")
    state(page, "act", 60)
    assert page.text("#confirm") == "Alle Prüflinge 180° um z drehen", "in the reader's language"
    assert page.script("return document.querySelectorAll('.turn svg').length") == 3
    page.keys("SN0003\n")
    page.wait("document.querySelector('#told').textContent === ''")
    page.keys("SN0001\n")
    page.wait("document.querySelector('#told').textContent.includes('wird in Nest A geprüft')")
    for width, height in SCREENS:
        page.device(width, height)
        assert judged(page, axe) == [], width
    page.go(page.script("return location.href"))
    page.wait("document.querySelector('#primary').offsetParent", 2)
    page.wait("performance.now() > 1200")  # a key that was meant for something else confirms nothing
    page.keys(F2)
    page.wait("document.body.dataset.state !== 'act'", 5)
    state(page, "done", 90)
    assert page.script("return document.querySelectorAll('.nest[data-outcome=PASS]').length") == 2
    assert "SN0003" in page.text("#coming")
    assert "IO" in page.text("[data-nest=A] .verdict"), "the verdict stays until the unit is changed"
    press(page)
    state(page, "scan")
    page.click("#start")
    page.wait("document.querySelector('[data-nest=A] [data-part=serial]').textContent === 'SN0003'", 30)
    state(page, "act", 60)
    press(page)
    page.wait(f"{verdict('A')} === 'PASS' && document.body.dataset.running === 'false'", 60)


def test_an_engineer_takes_a_unit_again_on_purpose(serve: Serve, log_in: LogIn, tmp_path: Path) -> None:
    fixture_run.run(tmp_path, ["SN0001"])
    site = serve()
    page = log_in(site, "olga")
    page.wait("document.activeElement.id === 'scan'")
    page.keys("SN0001\n")
    page.wait("document.querySelector('#told').textContent.includes('passed six-point on')")
    assert page.script("return document.querySelector('#again') === null"), "an operator may not"
    page = log_in(site, "emil")
    page.wait("document.activeElement.id === 'scan'")
    page.keys("SN0001\n")
    page.wait("document.activeElement.id === 'reason'")
    page.keys("returned by the customer\n")
    page.wait("document.querySelector('[data-nest=A] [data-part=serial]').textContent === 'SN0001'")
    page.wait("document.querySelector('#again') === null && document.activeElement.id === 'scan'")


def test_two_screens_and_a_lost_connection_show_the_same_truth(serve: Serve, log_in: LogIn) -> None:
    site = serve("--pace", "30")
    one, two = log_in(site), log_in(site, "ada")
    assert two.script("return document.querySelector('#scan') === null"), "an auditor only watches"
    scan(one, "SN0007")
    two.wait("document.querySelector('[data-nest=A] [data-part=serial]').textContent === 'SN0007'", 1.0)
    site.process.send_signal(signal.SIGSTOP)
    two.wait("document.body.dataset.lost === 'true' && !document.querySelector('#lost').hidden", 5)
    site.process.send_signal(signal.SIGCONT)
    two.wait("document.body.dataset.lost === 'false'", 1.5)
    scan(one, "SN0008")
    two.wait("document.querySelector('[data-nest=B] [data-part=serial]').textContent === 'SN0008'", 1.0)


def test_a_panel_that_dies_hurts_no_run_and_finds_it_again(serve: Serve, log_in: LogIn, tmp_path: Path) -> None:
    """The run goes on to its question to a person, where it waits however long another panel takes to start."""
    recipe = fixture_run.recipe(tmp_path, seatings={"turned": TURNED}, runs=RUNS)
    site = serve("--pace", "4", "--recipe", recipe)
    page = log_in(site)
    scan(page, "SN0001")
    page.click("#start")
    done = "document.querySelectorAll('.line [data-is=done]').length >= 2"
    page.wait(f"document.body.dataset.state === 'running' && {done}", 60)
    site.process.kill()
    page.wait("document.body.dataset.lost === 'true'", 5)
    again = log_in(serve("--pace", "4", "--recipe", recipe))
    again.wait(f"document.body.dataset.running === 'true' && {done}", 2)
    state(again, "act", 60)
    again.click("#stop")
    again.wait(f"{verdict('A')} === 'ABORTED' && document.body.dataset.running === 'false'", 20)


def test_sixty_updates_leave_nothing_behind(serve: Serve, log_in: LogIn, tmp_path: Path) -> None:
    site = serve()
    live = Path(f"{site.database}.live.json")
    nests = [
        {"serial": f"SN{i:04d}", "nest": n, "node": 17 + i, "outcome": "", "reasons": []} for i, n in enumerate("ABCD")
    ]
    document = {"schema": "station.live/1", "pid": 1, "recipe": "r/1", "unit": "g", "poses": []}

    def show(number: int) -> None:
        outcome = ("ABORTED", "PASS", "FAIL")[number % 3]
        reasons = [f"reason {number}.{i}" for i in range(number % 5)] or [f"number {number}."]
        changed = [
            {**n, "vector": [number / 1000, 0.0, 1.0], "noise": 1e-4, "outcome": outcome, "reasons": reasons}
            for n in nests
        ]
        present = {"nests": changed, "began_s": 7.0, "over": True, "fault": None, "total": 1000}
        extra = live.with_suffix(".tmp")
        extra.write_text(json.dumps({**document, "state": {**present, "done": number}}))
        extra.replace(live)

    page = log_in(site)
    observed = "/ {0}\\./.test(document.querySelector('[data-nest=A]').textContent)"

    def rounds(first: int, last: int) -> dict[str, int]:
        for number in range(first, last):
            show(number)
            page.wait(observed.format(number), 5)
        return page.memory()

    # Every fifteenth update shows the same. A swing of a whole page's nodes in one round tells nothing, a leak stays.
    found = [rounds(1, 15), *(rounds(last - 15, last) for last in (30, 45, 60, 75))]
    first, last = ({name: min(look[name] for look in two) for name in two[0]} for two in (found[:2], found[-2:]))
    assert last["Nodes"] < first["Nodes"] + 15, found  # a node an update would be 30 at least
    assert last["JSEventListeners"] <= first["JSEventListeners"], found
    assert last["JSHeapUsedSize"] < first["JSHeapUsedSize"] + 200_000, found
