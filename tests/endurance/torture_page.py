"""The page under attack: clients that hold connections open, feed requests drop by drop, and guess passwords.

    python tests/endurance/torture_page.py [--idle 1000] [--slow 1000] [--guesses 10000] [--stops 100] [--guessers 200]

A page serves in a process of its own. While the attack goes on from the operator's own address and under the operator's
name, until every guess is answered (checked, or turned away as too many wait), the operator presses Stop so many times
and more, each on a new connection, and logs in again: in the browser of before, and in a new one at another address.
Counted are answers, their times, and right passwords that were refused. Everything is HTTP by hand over sockets:
nothing of the page's code is used by the attackers.
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
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from urllib.parse import urlencode

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from station.panel_protocol import accounts
from station.panel_protocol.accounts import Account, Role

PASSWORD = "correct horse"
#: Guessers at work at the same time, and how long anybody waits for an answer, s.
GUESSERS, PATIENCE_S = 200, 60.0
#: Another address of this machine, where nobody guesses.
ELSEWHERE = "127.0.0.2"


@dataclass(frozen=True, slots=True)
class Counted:
    """What came of it. guesses: wrong log-ins that were answered, checked or turned_away; refused: right passwords that
    did not open; stop_*_s: until the answer to a Stop, log_in_slowest_s: to a right password."""

    idle: int
    slow: int
    guesses: int
    turned_away: int
    guesses_unanswered: int
    opened_by_guess: int
    stops: int
    stops_unanswered: int
    stop_median_s: float
    stop_p99_s: float
    log_ins: int
    refused: int
    log_in_slowest_s: float
    lasted_s: float


@dataclass(slots=True)
class Guessing:
    """Threads that guess one after the other, each with its own connections, and the statuses of their answers."""

    port: int
    guesses: int
    guessers: int
    statuses: Counter[int] = field(default_factory=Counter)
    _turn: threading.Lock = field(default_factory=threading.Lock)
    _threads: list[threading.Thread] = field(default_factory=list)

    def start(self) -> None:
        """Begins."""
        numbers = iter(range(self.guesses))
        self._threads = [
            threading.Thread(target=self._guess, args=(numbers,), daemon=True) for _ in range(self.guessers)
        ]
        for thread in self._threads:
            thread.start()

    @property
    def over(self) -> bool:
        """Whether every guess is answered, or given up."""
        return not any(thread.is_alive() for thread in self._threads)

    def _guess(self, numbers: Iterator[int]) -> None:
        while True:
            with self._turn:
                number = next(numbers, None)
            if number is None:
                return
            status, _ = request(self.port, "POST", "/login", {"name": "olga", "password": f"guess {number}"})
            with self._turn:
                self.statuses[status] += 1


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


def request(
    port: int, method: str, path: str, form: dict[str, str] | None = None, cookie: str = "", address: str = "127.0.0.1"
) -> tuple[int, str]:
    """One request on a connection of its own from that address: status and the whole answer; 0 where none came."""
    body = urlencode(form).encode() if form is not None else b""
    head = f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\nCookie: {cookie}\r\n"
    if form is not None:
        head += f"Content-Type: application/x-www-form-urlencoded\r\nContent-Length: {len(body)}\r\n"
    try:
        with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S, source_address=(address, 0)) as link:
            link.sendall(head.encode() + b"\r\n" + body)
            parts = []
            while part := link.recv(65536):
                parts.append(part)
    except OSError:
        return 0, ""
    text = b"".join(parts).decode("utf-8", "replace")
    return (int(text.split(" ", 2)[1]) if text.startswith("HTTP/1.1 ") else 0), text


def log_in(port: int, password: str, cookie: str = "", address: str = "127.0.0.1") -> str:
    """The cookies of a new session; '' where the password did not open."""
    form = {"name": "olga", "password": password}
    status, text = request(port, "POST", "/login", form, cookie, address)
    return "; ".join(re.findall(r"set-cookie: (station_[^;]+)", text)) if status == 303 else ""


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


class Operator:
    """Who is logged in, presses Stop, and logs in again; with how long each took, s."""

    def __init__(self, port: int) -> None:
        self._port, self._cookie, self._form = port, "", dict[str, str]()
        self.stops_s, self.log_ins_s = list[float](), list[float]()
        self.unanswered = self.refused = 0
        assert self.log_in(again=False), "before the attack the right password opens"
        self.log_ins_s.clear()

    def press_stop(self) -> None:
        """On a connection of its own."""
        begun_s = time.monotonic()
        status, _ = request(self._port, "POST", "/command", self._form, self._cookie)
        self.stops_s.append(time.monotonic() - begun_s)
        self.unanswered += status in (0, 503)

    def log_in(self, *, again: bool) -> bool:
        """In the browser of before, whose session is another one then, or in a new one at another address."""
        begun_s = time.monotonic()
        own = again or not self._cookie
        inside = log_in(self._port, PASSWORD, *((self._cookie, "127.0.0.1") if own else ("", ELSEWHERE)))
        self.log_ins_s.append(time.monotonic() - begun_s)
        self.refused += not inside
        if inside and own:
            self._cookie = inside
            page = request(self._port, "GET", "/", cookie=inside)[1]
            token = re.search(r'name="csrf" value="([^"]+)"', page)
            assert token is not None, page[:500]
            self._form = {"action": "stop", "csrf": token[1]}
        return bool(inside)


def attack(folder: Path, idle: int, slow: int, guesses: int, stops: int, guessers: int = GUESSERS) -> Counted:
    """Everything at once."""
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    with serving(folder) as port:
        operator = Operator(port)
        holders, guessing = Holders(port, idle, slow), Guessing(port, guesses, min(guessers, guesses))
        begun_s = time.monotonic()
        holders.start()
        guessing.start()
        while (number := len(operator.stops_s)) < stops or not guessing.over:
            operator.press_stop()
            if number % 10 == 0:
                operator.log_in(again=number % 20 == 0)
            time.sleep(0.02 if guessing.over else 0.2)
        lasted_s = time.monotonic() - begun_s
        holders.over.set()
        holders.join()
    times, answers = sorted(operator.stops_s), guessing.statuses
    return Counted(
        idle,
        slow,
        guesses=answers[401] + answers[429],
        turned_away=answers[429],
        guesses_unanswered=guesses - answers[401] - answers[429],
        opened_by_guess=answers[303],
        stops=len(times),
        stops_unanswered=operator.unanswered,
        stop_median_s=times[len(times) // 2],
        stop_p99_s=times[min(int(len(times) * 0.99), len(times) - 1)],
        log_ins=len(operator.log_ins_s),
        refused=operator.refused,
        log_in_slowest_s=max(operator.log_ins_s),
        lasted_s=lasted_s,
    )


def main() -> int:
    """Attacks and prints; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--idle", type=int, default=1000)
    parser.add_argument("--slow", type=int, default=1000)
    parser.add_argument("--guesses", type=int, default=10_000)
    parser.add_argument("--stops", type=int, default=100)
    parser.add_argument("--guessers", type=int, default=GUESSERS)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = attack(Path(folder), given.idle, given.slow, given.guesses, given.stops, given.guessers)
    if given.json:
        print(json.dumps(asdict(found)))
    else:
        print(
            f"{found.idle} idle and {found.slow} slow clients, {found.guesses} wrong log-ins answered "
            f"({found.turned_away} of them turned away, {found.guesses_unanswered} unanswered) in "
            f"{found.lasted_s:.0f} s while {found.stops} Stops were pressed: unanswered {found.stops_unanswered}, "
            f"median {found.stop_median_s:.3f} s, p99 {found.stop_p99_s:.3f} s; right passwords refused "
            f"{found.refused} of {found.log_ins}, slowest {found.log_in_slowest_s:.1f} s; "
            f"opened by a guess {found.opened_by_guess}"
        )
    missed = found.stops_unanswered or found.guesses_unanswered or found.refused or found.opened_by_guess
    return int(bool(missed or found.stop_p99_s > 0.5))


if __name__ == "__main__":
    sys.exit(main())
