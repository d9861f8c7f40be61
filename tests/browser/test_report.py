"""The diagnosis report, judged by axe-core in every look that the page around it may have."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.browser.chrome import Browser
from tests.browser.judge import judged
from tests.fakes.command import captured

pytestmark = pytest.mark.timeout(240)
_COLOURS = """
return [...document.querySelectorAll('*')].map((one) => {
  const style = getComputedStyle(one);
  return [style.color, style.backgroundColor, style.borderColor, style.fill, style.stroke].join(' ');
});
"""


def test_a_report_is_accessible_in_every_look(tmp_path: Path, open_browser: Callable[..., Browser], axe: str) -> None:
    samples, report = tmp_path / "s.parquet", tmp_path / "report.html"
    words = ("--recipe", "tilt-24", "--units", "2", "--seed", "3", "--effect", "cross-axis", "--out", samples)
    assert captured("simulate", *words).returncode == 0
    assert captured("diagnose", "--recipe", "tilt-24", "--samples", samples, "--report", report).returncode == 1
    page = open_browser()
    text, colours = report.read_text("utf-8"), {}
    for look in ("light", "dark", "hc"):
        report.write_text(text.replace("<html ", f'<html class="{look}" ', 1), "utf-8")
        for width, height in ((390, 844), (1280, 800)):
            page.size(width, height)
            page.go(report.as_uri())
            page.script("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
            assert judged(page, axe) == [], (look, width)
        colours[look] = page.script(_COLOURS)
    # The look that follows the desk has, colour by colour, those judged above.
    report.write_text(text.replace("<html ", '<html class="auto" ', 1), "utf-8")
    for scheme in ("light", "dark"):
        page.scheme(scheme)
        page.go(report.as_uri())
        assert page.script(_COLOURS) == colours[scheme], scheme
    assert colours["light"] != colours["dark"] != colours["hc"]
