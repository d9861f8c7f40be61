"""The operator's screen in its five states: readable, accessible, within the window, and as somebody has seen it."""

import json
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import cycle, product
from pathlib import Path
from typing import Any

import pytest

from station.wiring.jobs import load_job
from tests.browser import likeness
from tests.browser.chrome import Browser
from tests.browser.conftest import Site, logging_in
from tests.browser.judge import judged
from tests.browser.scenes import LATER, SIZES, STATES, Scene
from tests.fakes import fixture_run

LANGUAGES, THEMES = ("en", "de", "zh"), ("light", "dark", "hc")
REFERENCE = Path(__file__).parent / "reference"
pytestmark = pytest.mark.timeout(600)
#: Everything in every language and theme takes minutes: `make pictures` does that, and renews what is compared with.
WHOLE = bool(os.environ.get("STATION_PICTURES"))
TURNED = {"axis": [0, 0, 1], "angle_deg": 180}
RUNS = [{"seating": "home", "order": "listed"}, {"seating": "turned", "order": "reversed"}]

#: Bars glide to their place: two pictures later every glide has begun, and is taken to its end.
_AT_REST = """
const done = arguments[0];
requestAnimationFrame(() => requestAnimationFrame(() => {
  document.getAnimations().filter((a) => a instanceof CSSTransition).forEach((a) => a.finish());
  requestAnimationFrame(done);
}));
"""
#: What is cut off or lies beyond the window, where the page should have grown instead.
_CLIPPED = """
const wide = document.documentElement.clientWidth;
const cut = (n, style) => (style.overflowX === "hidden" && n.scrollWidth > n.clientWidth + 1)
  || (style.overflowY === "hidden" && n.scrollHeight > n.clientHeight + 1);
return [...document.querySelectorAll("main *, footer *, header *")]
  .filter((n) => n.offsetParent && !n.closest("svg, .sheet, .unseen, .name"))
  .filter((n) => n.getBoundingClientRect().right > wide + 1 || cut(n, getComputedStyle(n)))
  .map((n) => n.outerHTML.slice(0, 150));
"""
_FONT_PX = "return parseFloat(getComputedStyle(document.querySelector(arguments[0])).fontSize)"
_BOX = "const b = document.querySelector(arguments[0]).getBoundingClientRect(); return [b.width, b.height]"


@pytest.fixture(scope="module")
def stage(
    serve_shared: Callable[..., Site],
    open_shared: Callable[..., Browser],
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[tuple[Browser, Any]]:
    """A page in a browser, and what puts it into a state; two loads of the day are in the log."""
    recipe = fixture_run.recipe(tmp_path_factory.mktemp("recipe"), seatings={"turned": TURNED}, runs=RUNS)
    bench = tmp_path_factory.mktemp("bench")
    for number in (1, 5):
        serials = [f"SN{number + nest:05}" for nest in range(4)]
        fixture_run.run(bench, serials, recipe=recipe, faults=("SN00006/stuck-axis:value=1",) if number == 5 else ())
    site = serve_shared("--recipe", recipe, folder=bench)
    scene = Scene(site.database, load_job(recipe)[0].recipe, os.getpid())
    page = logging_in(open_shared)(site)

    held = ExitStack()

    def show(
        state: str,
        language: str = "en",
        theme: str = "light",
        size: tuple[int, int] = SIZES[0],
        later: tuple[str, ...] | None = None,
    ) -> None:
        held.close()
        scene.show(state, later if later is not None else LATER if state == "scan" else ())
        if state in ("running", "act"):
            held.enter_context(scene.running())
        page.size(*size)
        page.go(f"{site.url}/?language={language}&theme={theme}")
        page.wait(f"document.body.dataset.state === '{state}' && document.fonts.status === 'loaded'")
        if state == "ready":  # the listener beside the page has heard every unit
            page.wait("document.querySelectorAll('.nest .live').length === 4")
        page.script("document.activeElement.blur()")
        page.later(_AT_REST)

    with held:
        yield page, show
    page.size(1280, 800)


def combinations() -> list[tuple[str, tuple[int, int], str]]:
    """Every state in every size; in a quick look each with one language, every one of them in turn."""
    if WHOLE:
        return list(product(STATES, SIZES, LANGUAGES))
    languages = cycle(LANGUAGES)
    return [(state, size, next(languages)) for state, size in product(STATES, SIZES)]


def test_every_state_fits_is_accessible_and_looks_as_somebody_has_seen_it(
    stage: tuple[Browser, Any], axe: str, pictures: Path
) -> None:
    page, show = stage
    themes, changed = cycle(THEMES), []
    for state, size, language in combinations():
        show(state, language, "light", size)
        where = f"{state}-{language}-{size[0]}"
        assert page.script(_CLIPPED) == [], where
        tall = page.script("return document.documentElement.scrollHeight")
        assert tall <= size[1] + 1, f"{where}: {tall} px high"
        png = page.shot()
        if WHOLE:
            REFERENCE.mkdir(exist_ok=True)
            likeness.keep(png, REFERENCE / f"{where}.png")
            if (language, size) == ("en", SIZES[1]):
                (pictures / f"{state}.png").write_bytes(png)
        elif not likeness.is_alike(png, REFERENCE / f"{where}.png"):
            changed.append(f"{where}: {likeness.differences(png, REFERENCE / f'{where}.png')}")
        for theme in THEMES if WHOLE else [next(themes)]:
            page.script("document.documentElement.className = arguments[0]", theme)
            assert judged(page, axe) == [], f"{where}, {theme}"
    assert changed == [], "look at it; `make pictures` takes it over"


@pytest.mark.parametrize("state", ["scan", "ready", "running"])
def test_a_full_queue_finds_room_and_says_when_its_loads_begin(stage: tuple[Browser, Any], state: str) -> None:
    page, show = stage
    later = tuple(f"SN05{number}" for number in range(100, 112))
    for size, language in zip(SIZES, LANGUAGES, strict=True):
        show(state, language, "light", size, later)
        assert page.script(_CLIPPED) == [], f"{state}-{language}-{size[0]}"
        assert page.script("return document.documentElement.scrollHeight") <= size[1] + 1
        assert "12" in page.script("return document.querySelector('#queue h2').innerText")
        shown = page.script("return [...document.querySelectorAll('#queue li')].map(n => n.textContent)")
        for number, row in enumerate(shown):
            assert row.endswith("".join(later[4 * number : 4 * number + 4]))
            assert row.count(":") == 1, "when it begins"


def test_the_comparison_sees_what_a_person_would_see(stage: tuple[Browser, Any]) -> None:
    page, show = stage
    name = REFERENCE / "running-en-1280.png"
    for change in (
        "document.querySelector('#stop').remove()",
        "document.querySelector('[data-nest=B]').remove()",
        "document.querySelector('#stop').style.background = 'white'",
        "document.querySelector('main').style.direction = 'rtl'",
    ):
        show("running", size=SIZES[1])
        png = page.shot()
        assert likeness.is_alike(png, name), likeness.differences(png, name)
        page.script(change)
        page.later("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
        assert not likeness.is_alike(page.shot(), name), change


def test_what_must_be_read_from_two_metres_is_large(stage: tuple[Browser, Any]) -> None:
    page, show = stage

    def px(css: str) -> float:
        return float(page.script(_FONT_PX, css))

    for language in ("de", "zh"):
        show("done", language)
        assert px(".verdict strong") >= 120
        assert px(".why") >= 28
        assert px(".serial") >= 40
    show("running")
    assert px(".serial") >= 40
    assert px(".clockbox strong") >= 80
    wide, high = page.script(_BOX, "#stop")
    assert (wide >= 300, high >= 130) == (True, True)
    wide, high = page.script(_BOX, "#task")
    assert wide * high >= 0.2 * 1920 * 1080


def test_stop_is_there_only_while_it_can_act(stage: tuple[Browser, Any]) -> None:
    page, show = stage
    for state in STATES:
        show(state)
        there = page.script("return document.querySelectorAll('#stop').length")
        assert there == (1 if state in ("running", "act") else 0), state
        assert page.script("return document.querySelectorAll('button:disabled').length") == 0
        assert page.script("return document.querySelectorAll('.primary').length") <= 1


def test_a_zoomed_window_grows_and_hides_nothing(stage: tuple[Browser, Any]) -> None:
    page, show = stage
    for state, size in zip(STATES, cycle(((960, 540), (640, 400), (320, 256))), strict=False):
        show(state, size=size)
        assert page.script(_CLIPPED) == [], f"{state}, {size}"


def test_the_page_is_small_and_paints_at_once(stage: tuple[Browser, Any]) -> None:
    page, show = stage
    show("running")
    files = page.script("return performance.getEntriesByType('resource').map(r => [r.name, r.decodedBodySize])")
    scripts = {name: size for name, size in files if name.partition("?")[0].endswith(".js")}
    assert len(scripts) == 3
    assert sum(scripts.values()) <= 60_000, json.dumps(scripts)
