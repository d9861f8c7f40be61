"""An operator's shift in a real browser: log in, scan four, one fails, stop in the middle, reload, take up again."""

import json
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from station.adapters.store.reader import SqliteLogReader
from station.ports.log_reader import Query
from station.web.journal import Journal
from tests.browser.chrome import Browser
from tests.browser.conftest import Site
from tests.browser.judge import SCREENS, judged
from tests.fakes import fixture_run

Serve = Callable[..., Site]
LogIn = Callable[..., Browser]
pytestmark = pytest.mark.timeout(240)
F2 = "\ue032"


def verdict(nest: str) -> str:
    """JavaScript: what stands as a nest's verdict."""
    return f"document.querySelector('[data-nest={nest}] [data-part=verdict]').dataset.outcome"


def scan(page: Browser, *serials: str) -> None:
    """Types as a scanner does, and waits until each stands in its nest."""
    for serial in serials:
        page.keys(f"{serial}\n")
        page.wait(f"[...document.querySelectorAll('[data-part=serial]')].some(n => n.textContent === '{serial}')")


def test_a_shift(serve: Serve, log_in: LogIn, pictures: Path) -> None:
    site = serve("--pace", "8", "--fault", "SN0002/stuck-axis:value=2")
    page = log_in(site)
    page.wait("document.activeElement.id === 'scan'")
    page.keys("nonsense\n")
    page.wait("document.querySelector('#told').textContent.includes('does not match')")
    scan(page, "SN0001", "SN0002", "SN0003", "SN0004")
    page.keys("SN0001\n")
    page.wait("document.querySelector('#told').textContent.includes('listed twice')")
    page.click("#start")
    # One fails early, with its reason; the others go on.
    page.wait(f"{verdict('B')} === 'FAIL'", 60)
    page.wait("document.querySelector('#now-picture svg') && document.querySelector('#next-picture svg')", 20)
    assert "✘ FAIL" in page.text("[data-nest=B] .verdict")
    assert len(page.text("[data-nest=B] ul")) > 10
    page.wait("document.querySelector('[data-nest=A] [data-part=vector]').textContent.includes(' g')", 20)
    page.picture(pictures / "operator.png")
    # Reload in the middle: within a second the page knows as much as before.
    page.go(site.url)
    page.wait(f"{verdict('B')} === 'FAIL' && document.body.dataset.running === 'true'", 1.0)
    page.click("#stop")
    page.wait(f"{verdict('A')} === 'ABORTED' && document.body.dataset.running === 'false'", 20)
    assert "■ STOPPED" in page.text("[data-nest=A] .verdict")
    page.go(site.url)
    page.wait(f"{verdict('A')} === 'ABORTED'", 1.0)
    # Take up again what came to no verdict.
    page.click("#resume")
    page.wait("document.querySelector('[data-nest=A] .verdict').textContent.includes('scanned')")
    assert "scanned" not in page.text("[data-nest=B] .verdict")
    page.click("#start")
    page.wait("document.body.dataset.running === 'true'", 20)
    page.wait("document.querySelectorAll('[data-outcome=PASS]').length === 3", 90)
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
    assert actions == ["log-in", *["scan"] * 4, "start", "stop", "resume", "start"]


def test_the_keyboard_alone_does_it(serve: Serve, log_in: LogIn) -> None:
    page = log_in(serve("--pace", "30"))
    page.wait("document.activeElement.id === 'scan'")
    scan(page, "SN0001", "SN0002")
    enter, tab = "\ue007", "\ue004"
    page.keys(tab * 2)
    page.wait("document.activeElement.id === 'start'")
    page.keys(enter)
    page.wait("document.body.dataset.running === 'true'", 20)
    passed = "document.querySelectorAll('[data-outcome=PASS]').length === 2"
    page.wait(f"{passed} && document.body.dataset.running === 'false'", 60)
    # Wherever the focus is, a scanner's characters reach the scan field.
    page.keys(tab * 3)
    scan(page, "SN0003")


def test_an_operator_turns_the_units_by_hand_and_scans_the_next_load(
    serve: Serve, log_in: LogIn, tmp_path: Path, pictures: Path, axe: str
) -> None:
    turned = {"axis": [0, 0, 1], "angle_deg": 180}
    runs = [{"seating": "home", "order": "listed"}, {"seating": "turned", "order": "reversed"}]
    recipe = fixture_run.recipe(tmp_path, seatings={"turned": turned}, runs=runs)
    page = log_in(serve("--pace", "40", "--recipe", recipe), language="de")
    page.wait("document.activeElement.id === 'scan'")
    scan(page, "SN0001", "SN0002")
    page.click("#start")
    page.wait("!document.querySelector('#todo').hidden", 60)
    assert "(Sitzlage 'turned')" in page.text("#confirm"), "in the reader's language"
    page.keys("SN0003\n")
    page.wait("document.querySelector('[data-nest=A] [data-part=next]').textContent.includes('SN0003')")
    page.keys("SN0001\n")
    page.wait("document.querySelector('#told').textContent.includes('wird in Nest A geprüft')")
    page.picture(pictures / "confirm.png")
    for width, height in SCREENS:
        page.device(width, height)
        assert judged(page, axe) == [], width
    page.go(page.script("return location.href"))
    page.wait("!document.querySelector('#todo').hidden && document.querySelector('#confirmed').offsetParent", 2)
    page.wait("performance.now() > 1200")  # a key that was meant for something else confirms nothing
    page.keys(F2)
    page.wait("document.querySelector('#todo').hidden", 5)
    page.wait("document.querySelectorAll('[data-outcome=PASS]').length === 2", 90)
    page.wait("!document.querySelector('#coming').hidden", 20)
    assert "SN0003" in page.text("#coming")
    assert "GUT" in page.text("[data-nest=A] .verdict"), "the verdict stays until the unit is changed"
    page.click("#start")
    page.wait("document.querySelector('[data-nest=A] [data-part=serial]').textContent === 'SN0003'", 30)
    page.wait("!document.querySelector('#todo').hidden", 60)
    page.click("#confirmed")
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
    page.wait("document.querySelector('[data-nest=A] .verdict').textContent.includes('scanned')")
    page.wait("document.querySelector('#again').hidden && document.activeElement.id === 'scan'")


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


def test_a_panel_that_dies_hurts_no_run_and_finds_it_again(serve: Serve, log_in: LogIn) -> None:
    site = serve("--pace", "0.5")
    page = log_in(site)
    scan(page, "SN0001")
    page.click("#start")
    page.wait("document.querySelector('#count').textContent.startsWith('1 /')", 30)
    site.process.kill()
    page.wait("document.body.dataset.lost === 'true'", 5)
    again = log_in(serve("--pace", "0.5"))
    again.wait("document.body.dataset.running === 'true' && Number(document.querySelector('#bar').value) >= 1", 2)
    again.click("#stop")
    again.wait(f"{verdict('A')} === 'ABORTED' && document.body.dataset.running === 'false'", 20)


def test_a_thousand_updates_leave_nothing_behind(serve: Serve, log_in: LogIn, tmp_path: Path) -> None:
    site = serve()
    live = Path(f"{site.database}.live.json")
    nests = [
        {"serial": f"SN{i:04d}", "nest": n, "node": 17 + i, "outcome": "", "reasons": []} for i, n in enumerate("ABCD")
    ]
    document = {"schema": "station.live/1", "pid": 1, "recipe": "r/1", "unit": "g", "poses": []}

    def show(number: int) -> None:
        outcome = ("", "PASS", "FAIL")[number % 3]
        reasons = [f"reason {number}.{i}" for i in range(number % 5)]
        changed = [
            {**n, "vector": [number / 1000, 0.0, 1.0], "noise": 1e-4, "outcome": outcome, "reasons": reasons}
            for n in nests
        ]
        sentences = [f"sentence {number - i}" for i in range(20)]
        state = {"nests": changed, "done": number, "total": 1000, "messages": sentences, "over": True, "fault": ""}
        extra = live.with_suffix(".tmp")
        extra.write_text(json.dumps({**document, "state": state}))
        extra.replace(live)

    page = log_in(site)
    observed = "document.querySelector('#count').textContent.startsWith('{} /')"

    def rounds(first: int, last: int) -> dict[str, int]:
        for number in range(first, last):
            show(number)
            page.wait(observed.format(number), 5)
        return page.memory()

    before = rounds(1, 60)
    after = rounds(60, 1060)
    assert after["Nodes"] <= before["Nodes"] + 50
    assert after["JSEventListeners"] <= before["JSEventListeners"]
    assert after["JSHeapUsedSize"] < before["JSHeapUsedSize"] + 300_000
