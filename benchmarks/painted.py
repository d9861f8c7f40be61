"""How long from an event of the run until it stands painted on a screen, in Debian's Chromium."""

import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.browser.chrome import Browser, driver

#: When the first reading has changed: the instant after the frame that shows it was handed to the screen.
_WATCH = """
window.painted = {};
const nests = document.querySelector('#nests');
new MutationObserver(() => {
  const number = Math.round(1000 * parseFloat(nests.querySelector('.live b').textContent));
  requestAnimationFrame(() => {
    const after = new MessageChannel();
    after.port1.onmessage = () => { window.painted[number] = performance.timeOrigin + performance.now(); };
    after.port2.postMessage(0);
  });
}).observe(nests, { childList: true, characterData: true, subtree: true });
"""


@contextmanager
def screen(url: str, name: str, password: str) -> Iterator[Browser]:
    """The operator's page in a browser, logged in, with a watch on what it paints."""
    programs = shutil.which("chromium"), shutil.which("chromedriver")
    if None in programs:
        sys.exit("the painted figure needs a browser: as root, apt-get install -y chromium chromium-driver")
    with driver(str(programs[1])) as at:
        browser = Browser(at, str(programs[0]))
        try:
            browser.go(url)
            browser.type("#name", name)
            browser.type("#password", f"{password}\n")
            browser.wait("document.querySelector('#recipe').textContent")
            browser.script(_WATCH)
            yield browser
        finally:
            browser.close()


def painted(browser: Browser, show: Callable[[int], None], numbers: range) -> list[float]:
    """Seconds from showing each number (replacing the run's live file) to the frame that has it."""
    took = []
    for number in numbers:
        began_s = time.time()
        show(number)
        browser.wait(f"window.painted[{number}]", 20)
        took.append(browser.script("return window.painted[arguments[0]]", number) / 1e3 - began_s)
    return took
