"""Every page, judged by axe-core against WCAG 2.2 AA, on a desk, a 10-inch touch screen and a phone."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.browser.chrome import Browser
from tests.browser.conftest import Site
from tests.browser.judge import SCREENS, judged
from tests.fakes import fixture_run

PHONE = SCREENS[-1]
PAGES = (
    "/",
    "/cards",
    "/audit",
    "/audit/unit?serial=SN0001",
    "/audit/unit?serial=SN0002",
    "/journal",
    "/charts?size=2",
    "/diagnosis",
    "/diagnosis/changes",
    "/nowhere",
)
pytestmark = pytest.mark.timeout(240)

#: What sticks out on the right of a page that must not be moved sideways; tables scroll in boxes of their own, but for
#: lists of units on a phone.
_SIDEWAYS = """
const wide = document.documentElement.clientWidth;
const own = `.scroll${wide < 640 ? ":not(.stacked)" : ""}, .unseen, .skip, .sheet, svg`;
return [...document.querySelectorAll("body *")]
  .filter((n) => n.getBoundingClientRect().right > wide + 1 && !n.closest(own))
  .map((n) => n.outerHTML.slice(0, 120));
"""
#: Drawings that would have to be moved sideways to be seen whole.
_CUT_FIGURES = """
return [...document.querySelectorAll("figure")].filter((n) => n.scrollWidth > n.clientWidth + 1)
  .map((n) => n.outerHTML.slice(0, 120));
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log with one unit that passed twice and one that failed."""
    made = tmp_path_factory.mktemp("log")
    fixture_run.run(made, ["SN0001", "SN0002"], faults=("SN0002/stuck-axis:value=2",))
    fixture_run.run(made, ["SN0001"])
    return made


@pytest.fixture(scope="module")
def site(serve_shared: Callable[..., Site], folder: Path) -> Site:
    """A panel on that log."""
    return serve_shared(folder=folder)


def test_pages_are_accessible_on_every_screen(site: Site, log_in: Callable[..., Browser], axe: str) -> None:
    page = log_in(site, "emil")
    for at in PAGES:
        page.go(f"{site.url}{at}")
        if at == "/":
            page.wait("document.querySelector('#recipe').textContent")
        for width, height in SCREENS:
            page.device(width, height)
            assert judged(page, axe) == [], at
            assert page.script(_SIDEWAYS) == [], f"{at} at {width} px"
            assert page.script(_CUT_FIGURES) == [], f"{at} at {width} px"
            small = page.script(
                "return [...document.querySelectorAll('button, input:not([type=hidden]):not([type=checkbox]), select')]"
                ".filter(n => n.offsetParent && n.offsetHeight < 44).map(n => n.outerHTML)"
            )
            assert small == [], "a finger needs 44 px"


def test_the_log_in_is_accessible(site: Site, open_browser: Callable[..., Browser], axe: str) -> None:
    page = open_browser()
    page.go(site.url)
    assert judged(page, axe) == []


def test_the_languages_of_the_page(site: Site, open_browser: Callable[..., Browser], axe: str, pictures: Path) -> None:
    page = open_browser(language="de")
    page.go(site.url)
    assert "Anmelden" in page.text("main")
    page.type("#name", "olga")
    page.type("#password", "correct horse\n")
    page.wait("document.querySelector('#menu')")
    page.wait("document.querySelector('#task').textContent.includes('für Nest A')")
    page.device(*PHONE)
    page.picture(pictures / "phone.png")
    page.go(f"{site.url}/?language=zh")
    page.wait("document.querySelector('#task').textContent.includes('扫描')")
    assert page.script("return document.documentElement.lang") == "zh"
    assert judged(page, axe) == []


def test_an_auditor_finds_a_unit_and_computes_it_again(
    site: Site, log_in: Callable[..., Browser], pictures: Path, axe: str
) -> None:
    page = log_in(site, "ada")
    page.go(f"{site.url}/audit")
    page.type("#serial", "SN000*")
    page.type("#nest", "A\n")
    page.wait("document.querySelectorAll('tbody tr').length === 2 && location.search.includes('nest=A')")
    page.picture(pictures / "audit.png")
    page.go(f"{site.url}/audit/unit?serial=SN0001")
    assert page.text("main").count("PASS") == 3, "the verdict, and one a row of the attempts"
    page.picture(pictures / "unit.png")
    page.click("form[action='/audit/recompute'] button")
    page.wait("document.querySelector('main [role=status]').textContent.includes('bit for bit')")
    assert judged(page, axe) == []
    page.go(f"{site.url}/audit/unit?serial=SN0001")
    page.click("a[href^='/audit/certificate']")
    page.wait("document.querySelector('h1').textContent.includes('certificate SN0001')")
    assert judged(page, axe) == []
    page.picture(pictures / "certificate.png")


def test_paper_is_white_and_bears_no_buttons_in_the_dark_look_either(
    site: Site, log_in: Callable[..., Browser]
) -> None:
    page = log_in(site, "emil")
    for path in ("/audit?theme=dark", "/audit/unit?serial=SN0002&theme=dark", "/charts?theme=dark"):
        page.go(f"{site.url}{path}")
        page.paper(on=True)
        look = "const s = getComputedStyle(document.documentElement); return [s.backgroundColor, s.colorScheme]"
        assert page.script(look) == ["rgb(255, 255, 255)", "light"], path
        shown = "return [...document.querySelectorAll('button, input, select')].filter((n) => n.offsetParent).length"
        assert page.script(shown) == 0, path
        page.paper(on=False)
