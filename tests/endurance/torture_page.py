"""The page under attack: clients that hold connections open, feed requests drop by drop, and guess passwords.

    python tests/endurance/torture_page.py [--idle 1000] [--slow 1000] [--guesses 10000] [--stops 100] [--json]

A page serves in a process of its own. While the attack goes on from the operator's own address, the operator presses
Stop so many times, each on a new connection, and logs in again; counted are answers, their times, and right passwords
that were refused. Everything is HTTP by hand over sockets: nothing of the page's code is used by the attackers.
"""

import argparse
import contextlib
import json
import re
import resource
import selectors
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from urllib.parse import urlencode

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from station.panel_protocol import accounts
from station.panel_protocol.accounts import Account, Role

PASSWORD = "correct horse"
#: Guessers at work at the same time, and how long anybody waits for an answer, s.
GUESSERS, PATIENCE_S = 20, 60.0


@dataclass(frozen=True, slots=True)
class Counted:
    """What came of it. refused: right passwords that did not open; stop_*_s: until the answer to a Stop."""

    idle: int
    slow: int
    guesses: int
    opened_by_guess: int
    stops: int
    stops_unanswered: int
    stop_median_s: float
    stop_p99_s: float
    log_ins: int
    refused: int


@contextlib.contextmanager
def serving(folder: Path) -> Iterator[int]:
    """A page in a process of its own; its port."""
    accounts.save(folder / "accounts.json", {"olga": Account("olga", Role.OPERATOR, accounts.hash_password(PASSWORD))})
    words = [sys.executable, "-P", "-m", "station", "panel", "--simulate", "--db", str(folder / "s.db"), "--port", "0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, cwd=folder) as process:
        assert process.stdout is not None
        try:
            yield int(process.stdout.readline().strip().rpartition(":")[2])
        finally:
            process.terminate()


def request(port: int, method: str, path: str, form: dict[str, str] | None = None, cookie: str = "") -> tuple[int, str]:
    """One request on a connection of its own: status and the whole answer; 0 where none came."""
    body = urlencode(form).encode() if form is not None else b""
    head = f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\nCookie: {cookie}\r\n"
    if form is not None:
        head += f"Content-Type: application/x-www-form-urlencoded\r\nContent-Length: {len(body)}\r\n"
    try:
        with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as link:
            link.sendall(head.encode() + b"\r\n" + body)
            parts = []
            while part := link.recv(65536):
                parts.append(part)
    except OSError:
        return 0, ""
    text = b"".join(parts).decode("utf-8", "replace")
    return (int(text.split(" ", 2)[1]) if text.startswith("HTTP/1.1 ") else 0), text


def log_in(port: int, password: str) -> str:
    """The cookie of a new session; '' where the password did not open."""
    status, text = request(port, "POST", "/login", {"name": "olga", "password": password})
    found = re.search(r"set-cookie: (station_session=[^;]+)", text)
    return found[1] if status == 303 and found else ""


class Holders(threading.Thread):
    """Holds connections, opens each anew as soon as the page closes it, and feeds those called slow a byte a second."""

    def __init__(self, port: int, idle: int, slow: int) -> None:
        super().__init__(daemon=True)
        self._port, self._wanted = port, [False] * idle + [True] * slow
        self.over = threading.Event()

    def run(self) -> None:
        """Until it is over."""
        watched = selectors.DefaultSelector()
        for drips in self._wanted:
            self._open(watched, drips)
        while not self.over.wait(0.05):
            for key, _ in watched.select(0.0):
                with contextlib.suppress(OSError):
                    if key.fileobj.recv(4096):  # type: ignore[union-attr]
                        continue
                watched.unregister(key.fileobj)
                key.fileobj.close()  # type: ignore[union-attr]
                self._open(watched, key.data)
            if int(time.monotonic() * 20) % 20 == 0:
                for key in list(watched.get_map().values()):
                    with contextlib.suppress(OSError):
                        if key.data:
                            key.fileobj.send(b"x")  # type: ignore[union-attr]
        for key in list(watched.get_map().values()):
            key.fileobj.close()  # type: ignore[union-attr]

    def _open(self, watched: selectors.BaseSelector, drips: bool) -> None:
        with contextlib.suppress(OSError):
            link = socket.create_connection(("127.0.0.1", self._port), timeout=5.0)
            if drips:
                link.sendall(b"POST /login HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 60000\r\nX: ")
            watched.register(link, selectors.EVENT_READ, drips)


def attack(folder: Path, idle: int, slow: int, guesses: int, stops: int, guessers: int = GUESSERS) -> Counted:
    """Everything at once."""
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    opened = 0
    with serving(folder) as port:
        cookie = log_in(port, PASSWORD)
        assert cookie, "before the attack the right password opens"
        token = re.search(r'name="csrf" value="([^"]+)"', request(port, "GET", "/", cookie=cookie)[1])
        assert token is not None
        holders = Holders(port, idle, slow)
        holders.start()
        left, over = iter(range(guesses)), threading.Event()
        turn = threading.Lock()

        def guess() -> None:
            nonlocal opened
            while not over.is_set():
                with turn:
                    number = next(left, None)
                if number is None:
                    return
                opened += bool(log_in(port, f"guess {number}"))

        threads = [threading.Thread(target=guess, daemon=True) for _ in range(min(guessers, guesses))]
        for thread in threads:
            thread.start()
        times, unanswered, refused, log_ins = [], 0, 0, 0
        for number in range(stops):
            began_s = time.monotonic()
            status, _ = request(port, "POST", "/command", {"action": "stop", "csrf": token[1]}, cookie)
            unanswered += status in (0, 503)
            times.append(time.monotonic() - began_s)
            if number % 20 == 0:
                log_ins += 1
                refused += not log_in(port, PASSWORD)
            time.sleep(0.02)
        for thread in threads:
            thread.join(0.0 if stops else None)
        over.set()
        holders.over.set()
        holders.join()
    times.sort()
    done = guesses - sum(1 for _ in left)
    median_s, p99_s = times[len(times) // 2], times[min(int(len(times) * 0.99), len(times) - 1)]
    return Counted(idle, slow, done, opened, stops, unanswered, median_s, p99_s, log_ins, refused)


def main() -> int:
    """Attacks and prints; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--idle", type=int, default=1000)
    parser.add_argument("--slow", type=int, default=1000)
    parser.add_argument("--guesses", type=int, default=10_000)
    parser.add_argument("--stops", type=int, default=100)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = attack(Path(folder), given.idle, given.slow, given.guesses, given.stops)
    if given.json:
        print(json.dumps(asdict(found)))
    else:
        print(
            f"{found.idle} idle and {found.slow} slow clients, {found.guesses} guesses while {found.stops} Stops were "
            f"pressed: unanswered {found.stops_unanswered}, median {found.stop_median_s:.3f} s, p99 "
            f"{found.stop_p99_s:.3f} s; right passwords refused {found.refused} of {found.log_ins}; "
            f"opened by a guess {found.opened_by_guess}"
        )
    return int(bool(found.stops_unanswered or found.refused or found.opened_by_guess or found.stop_p99_s > 0.5))


if __name__ == "__main__":
    sys.exit(main())
