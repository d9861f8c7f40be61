"""Chromium as Debian ships it, the accessibility judge from npm, and a panel process with people and a log."""

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from station.panel_protocol import accounts
from station.panel_protocol.accounts import Account, Role
from tests.browser.chrome import Browser, driver

PASSWORD = "correct horse"
_PEERS = Path(__file__).parent / "peers"


@dataclass(frozen=True)
class Site:
    """A panel process. folder: where its log is."""

    url: str
    folder: Path
    process: subprocess.Popen[str]

    @property
    def database(self) -> Path:
        return self.folder / "station.db"


@pytest.fixture(scope="session")
def programs() -> tuple[str, str]:
    """chromium and chromedriver: those installed, else fetched by apt."""
    wanted = ("chromium", "chromedriver")
    if not all(map(shutil.which, wanted)):
        for words in (["update"], ["install", "-y", "chromium", "chromium-driver"]):
            _apt_get(words)
    if not subprocess.run(["fc-list", ":lang=zh"], check=False, capture_output=True).stdout:
        _apt_get(["install", "-y", "fonts-noto-core", "fonts-wqy-microhei"])
    chromium, chromedriver = map(shutil.which, wanted)
    assert chromium
    assert chromedriver, "the package chromium-driver brings no chromedriver"
    return chromium, chromedriver


def _apt_get(words: list[str], patience_s: float = 600.0) -> None:
    """Runs apt-get; while another process holds the package manager's lock, waits for its end."""
    until_s = time.monotonic() + patience_s
    while True:
        done = subprocess.run(["apt-get", "--quiet", *words], check=False, capture_output=True, text=True, timeout=600)
        if done.returncode == 0:
            return
        held = "Could not get lock" in done.stderr or "Unable to acquire" in done.stderr
        assert held and time.monotonic() < until_s, f"as root: apt-get {' '.join(words)}\n{done.stderr[-1000:]}"
        time.sleep(1.0)


@pytest.fixture(scope="session")
def driver_url(programs: tuple[str, str]) -> Iterator[str]:
    """Where the one chromedriver listens."""
    with driver(programs[1]) as url:
        yield url


def _windows(program: str, driver_url: str) -> Iterator[Callable[..., Browser]]:
    opened: list[Browser] = []

    def make(size: tuple[int, int] = (1280, 800), language: str = "en") -> Browser:
        opened.append(Browser(driver_url, program, size, language))
        return opened[-1]

    yield make
    for browser in opened:
        browser.close()


@pytest.fixture
def open_browser(programs: tuple[str, str], driver_url: str) -> Iterator[Callable[..., Browser]]:
    """Makes windows; all are closed with the test, since a page left open goes on drawing."""
    yield from _windows(programs[0], driver_url)


@pytest.fixture(scope="module")
def open_shared(programs: tuple[str, str], driver_url: str) -> Iterator[Callable[..., Browser]]:
    """The same for windows that the tests of a file share."""
    yield from _windows(programs[0], driver_url)


def logging_in(open_browser: Callable[..., Browser]) -> Callable[..., Browser]:
    """Opens a window in which somebody has logged in."""

    def make(site: Site, name: str = "olga", **options: object) -> Browser:
        browser = open_browser(**options)
        browser.go(site.url)
        browser.type("#name", name)
        browser.type("#password", f"{PASSWORD}\n")
        browser.wait("document.querySelector('header form, #menu')")
        return browser

    return make


@pytest.fixture
def log_in(open_browser: Callable[..., Browser]) -> Callable[..., Browser]:
    """A window in which somebody has logged in."""
    return logging_in(open_browser)


@pytest.fixture(scope="session")
def people() -> dict[str, Account]:
    hashed = accounts.hash_password(PASSWORD)
    names = {"olga": Role.OPERATOR, "emil": Role.ENGINEER, "ada": Role.AUDITOR}
    return {name: Account(name, role, hashed) for name, role in names.items()}


def _panels(people: dict[str, Account], own: Path) -> Iterator[Callable[..., Site]]:
    running: list[subprocess.Popen[str]] = []

    def start(*more: str, folder: Path = own) -> Site:
        accounts.save(folder / "accounts.json", people)
        words = ["panel", "--simulate", "--db", str(folder / "station.db"), "--port", "0", *more]
        process = subprocess.Popen(
            [sys.executable, "-m", "station", *words], stdout=subprocess.PIPE, text=True, cwd=folder
        )
        running.append(process)
        assert process.stdout is not None
        return Site(process.stdout.readline().strip(), folder, process)

    yield start
    for process in running:
        process.terminate()
        process.wait(15)
        assert process.stdout is not None
        process.stdout.close()


@pytest.fixture
def serve(people: dict[str, Account], tmp_path: Path) -> Iterator[Callable[..., Site]]:
    """Starts panel processes on simulated stations."""
    yield from _panels(people, tmp_path)


@pytest.fixture(scope="module")
def serve_shared(people: dict[str, Account], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Site]]:
    """The same for panels that the tests of a file share."""
    yield from _panels(people, tmp_path_factory.mktemp("panel"))


@pytest.fixture(scope="session")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the tests leave what they saw: the guide's pictures are replaced only by `make pictures`."""
    named = os.environ.get("STATION_PICTURES")
    return Path(named).resolve() if named else tmp_path_factory.mktemp("pictures")


@pytest.fixture(scope="session")
def axe() -> str:
    """axe-core's script, fetched once by npm as the lock file pins it."""
    lock = (_PEERS / "package-lock.json").read_bytes()
    cache = Path(os.environ.get("STATION_TEST_CACHE") or Path.home() / ".cache" / "station-tests")
    target = cache / "axe" / hashlib.sha256(lock).hexdigest()[:12]
    if not target.is_dir():
        target.parent.mkdir(parents=True, exist_ok=True)
        npm = shutil.which("npm")
        assert npm, "axe-core comes by npm: as root, apt-get install -y npm"
        with tempfile.TemporaryDirectory(dir=target.parent) as work:
            for name in ("package.json", "package-lock.json"):
                shutil.copy(_PEERS / name, work)
            words = [npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund"]
            done = subprocess.run(words, cwd=work, check=False, capture_output=True, text=True, timeout=300)
            assert done.returncode == 0, f"npm ci fails:\n{done.stderr[-1500:]}"
            Path(work, "node_modules").rename(target)
    return (target / "axe-core" / "axe.min.js").read_text(encoding="utf-8")
