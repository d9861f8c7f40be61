"""A real Chromium, driven over the WebDriver protocol (W3C): as much of it as these tests need."""

import base64
import json
import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx2 as httpx

_ELEMENT = "element-6066-11e4-a52e-4f735466cecf"
_CLICKS = 10
#: How often memory is looked at: a collection may leave what the page took away in that instant to the next one.
_LOOKS = 4
_OPTIONS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--js-flags=--expose-gc",
            "--enable-precise-memory-info", "--hide-scrollbars", "--no-first-run", "--lang=en")  # fmt: skip

#: Polls in the page itself, so that nothing here sleeps; a condition that throws is not met yet. The condition stands
#: in the text, because the page's own policy forbids to make functions out of strings.
_WAIT = """
const [limit_ms, done] = arguments;
const until = performance.now() + limit_ms;
(function look() {
  let value = null;
  try { value = (CONDITION); } catch { value = null; }
  if (value || performance.now() > until) done(value ? true : null); else setTimeout(look, 10);
})();
"""


class Browser:
    """One window of its own profile. Errors: AssertionError with what the driver said."""

    def __init__(self, driver: str, binary: str, size: tuple[int, int] = (1280, 800), language: str = "en") -> None:
        self._http = httpx.Client(timeout=240)
        width, height = size
        options = [*_OPTIONS, f"--window-size={width},{height}", f"--accept-lang={language}"]
        wanted = {"browserName": "chrome", "goog:chromeOptions": {"binary": binary, "args": options}}
        made = self._call("POST", f"{driver}/session", {"capabilities": {"alwaysMatch": wanted}})
        self._url = f"{driver}/session/{made['sessionId']}"
        self._call("POST", f"{self._url}/timeouts", {"script": 200_000, "implicit": 5_000})

    def close(self) -> None:
        """Ends the session."""
        self._call("DELETE", self._url)
        self._http.close()

    def go(self, url: str) -> None:
        """Opens a page and waits until it is loaded."""
        self._call("POST", f"{self._url}/url", {"url": url})

    def script(self, text: str, *arguments: Any) -> Any:
        """What a script in the page returns."""
        return self._call("POST", f"{self._url}/execute/sync", {"script": text, "args": list(arguments)})

    def later(self, text: str) -> Any:
        """What a script hands to the function that is its only argument."""
        return self._call("POST", f"{self._url}/execute/async", {"script": text, "args": []})

    def wait(self, condition: str, limit_s: float = 15.0) -> None:
        """Waits until a JavaScript expression is true; a page that is left meanwhile is waited for on the next one."""
        body = {"script": _WAIT.replace("CONDITION", condition), "args": [limit_s * 1000]}
        for last in (False, True):
            try:
                value = self._call("POST", f"{self._url}/execute/async", body)
                break
            except AssertionError:
                if last:
                    raise
        assert value, f"not met within {limit_s:g} s: {condition}; the page says: {self.text('body')[:1500]}"

    def text(self, css: str) -> str:
        """The visible text of an element."""
        return str(self.script("return document.querySelector(arguments[0]).innerText", css))

    def click(self, css: str) -> None:
        """A real click: refused where something lies over the element. One that the page draws anew is found again:
        on a busy machine the page may draw several times between finding and clicking."""
        for tries_left in reversed(range(_CLICKS)):
            try:
                self._call("POST", f"{self._url}/element/{self._find(css)}/click", {})
                return
            except AssertionError as refused:
                if not tries_left or "stale element" not in str(refused):
                    raise

    def hold(self, css: str) -> None:
        """Presses the mouse's button over an element and does not let it go."""
        where = {"type": "pointerMove", "x": 0, "y": 0, "origin": {_ELEMENT: self._find(css)}}
        device = {"type": "pointer", "id": "mouse", "actions": [where, {"type": "pointerDown", "button": 0}]}
        self._call("POST", f"{self._url}/actions", {"actions": [device]})

    def drag(self, css: str, from_px: int, to_px: int) -> None:
        """Drags across an element with the mouse, from and to a distance from its middle."""
        origin = {_ELEMENT: self._find(css)}
        moves = [{"type": "pointerMove", "x": x, "y": 0, "origin": origin} for x in (from_px, to_px)]
        actions = [moves[0], {"type": "pointerDown", "button": 0}, moves[1], {"type": "pointerUp", "button": 0}]
        device = {"type": "pointer", "id": "mouse", "actions": actions}
        self._call("POST", f"{self._url}/actions", {"actions": [device]})

    def type(self, css: str, words: str) -> None:
        """Types into an element."""
        self._call("POST", f"{self._url}/element/{self._find(css)}/value", {"text": words})

    def keys(self, words: str) -> None:
        """Types wherever the focus is, as a scanner does."""
        actions = [{"type": kind, "value": key} for key in words for kind in ("keyDown", "keyUp")]
        device = {"type": "key", "id": "keyboard", "actions": actions}
        self._call("POST", f"{self._url}/actions", {"actions": [device]})

    def picture(self, path: Path) -> None:
        """A screenshot of the whole page."""
        tall = self.script("return Math.ceil(document.documentElement.scrollHeight)")
        wide = self.script("return window.innerWidth")
        size = {"width": wide, "height": tall, "deviceScaleFactor": 1, "mobile": False}
        self._chrome("Emulation.setDeviceMetricsOverride", size)
        shot = self._chrome("Page.captureScreenshot", {"format": "png"})
        self._chrome("Emulation.clearDeviceMetricsOverride", {})
        path.write_bytes(base64.b64decode(shot["data"]))

    def shot(self) -> bytes:
        """What the window shows, as PNG."""
        return base64.b64decode(self._chrome("Page.captureScreenshot", {"format": "png"})["data"])

    def size(self, width: int, height: int) -> None:
        """A window of that size, in CSS pixels; a narrow one is a phone's."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
        self._chrome("Emulation.setDeviceMetricsOverride", size)

    def device(self, width: int, height: int) -> None:
        """A touch screen of that size, in CSS pixels."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": True}
        self._chrome("Emulation.setDeviceMetricsOverride", size)

    def paper(self, *, on: bool) -> None:
        """As it would be printed, or on the screen again."""
        self._chrome("Emulation.setEmulatedMedia", {"media": "print" if on else ""})

    def scheme(self, name: str) -> None:
        """The colours that the person's desk asks for: light or dark."""
        self._chrome("Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": name}]})

    def memory(self) -> dict[str, int]:
        """Nodes, listeners and bytes that the page holds: the least of several looks, each after a collection of
        garbage. What a leak holds is there at every look."""
        self._chrome("Performance.enable", {})
        looks = [self._memory_now() for _ in range(_LOOKS)]
        return {name: min(look[name] for look in looks) for name in ("Nodes", "JSEventListeners", "JSHeapUsedSize")}

    def _memory_now(self) -> dict[str, int]:
        self._chrome("HeapProfiler.collectGarbage", {})
        found = self._chrome("Performance.getMetrics", {})["metrics"]
        return {metric["name"]: int(metric["value"]) for metric in found}

    def _chrome(self, command: str, parameters: dict[str, Any]) -> Any:
        return self._call("POST", f"{self._url}/goog/cdp/execute", {"cmd": command, "params": parameters})

    def _find(self, css: str) -> str:
        found = self._call("POST", f"{self._url}/element", {"using": "css selector", "value": css})
        return str(found[_ELEMENT])

    def _call(self, method: str, url: str, body: dict[str, Any] | None = None) -> Any:
        answer = self._http.request(method, url, content=None if body is None else json.dumps(body))
        value = answer.json()["value"]
        assert answer.status_code == 200, f"{method} {url.rpartition('/')[2]}: {value}"
        return value


@contextmanager
def driver(program: str) -> Iterator[str]:
    """The address of a running chromedriver on a port of its own choice."""
    words = [program, "--port=0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        try:
            assert process.stdout is not None
            lines = iter(process.stdout.readline, "")
            port = next(found[1] for line in lines if (found := re.search(r"started successfully on port (\d+)", line)))
            yield f"http://127.0.0.1:{port}"
        finally:
            process.terminate()
            process.wait(10)
