"""axe-core's judgement of a page against WCAG 2.2 AA, on every screen that the page is made for."""

from tests.browser.chrome import Browser

#: A desk or a large touch screen, a 10-inch one, a phone; CSS pixels.
SCREENS = ((1280, 800), (1024, 600), (390, 844))

#: Only violations are told, and by their HTML: paths to every element that passed would take most of the time.
_JUDGE = """
const done = arguments[0];
const tags = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"];
axe.run(document, { runOnly: tags, resultTypes: ["violations"], selectors: false, preload: false })
  .then((found) => done(found.violations.map((v) => `${v.id}: ${v.nodes.map((n) => n.html).slice(0, 3).join(" | ")}`)));
"""


def judged(page: Browser, axe: str) -> list[str]:
    """What axe-core finds wrong with the page as it stands."""
    if not page.script("return 'axe' in window"):
        page.script(axe)
    return list(page.later(_JUDGE))
