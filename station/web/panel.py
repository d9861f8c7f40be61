"""Everything the page stands on, made once and handed to every route as `request.app.state.panel`."""

import subprocess
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from types import MappingProxyType

from anyio import CapacityLimiter

from station.config.settings import Settings
from station.domain.recipe.recipe import Recipe
from station.errors import LogError
from station.panel_protocol.account_seal import check_sealed
from station.panel_protocol.accounts import Account, load
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.journal import Journal
from station.panel_protocol.queue import LoadQueue
from station.ports.log_reader import LogReader
from station.web.fair_turns import FairTurns
from station.web.line_cache import LineCache
from station.web.run_launcher import LaunchOptions, RunLauncher
from station.web.screen import Screen
from station.web.sessions import LoginThrottle, Sessions
from station.wiring.accounts import known_seal
from station.wiring.logs import open_log

_RIGHTS_AT_PLANT = frozenset({"watch", "audit", "charts"})


@dataclass(slots=True)
class Panel:
    """Settings and recipe of the station; the people's file; how runs are started; open sessions.

    plant: address of the plant whose records the page reads, and does nothing else; "" for the station's own log.
    secure: the page is reached by https only, so cookies are too. host_names: by which names it is reached; None: by
    any. over: the server ends, and so do its streams. monotonic_s: the clock of sessions and guesses. children:
    diagnoses under way, by name. memory: what the charts remember. hashing: two passwords at most are checked at a
    time, each takes 128 MiB; password_turns, guesser_turns: one of guessers and one of all others. turned_away: tries
    that found too many waiting. turn: one action after the other; a stop waits for none.
    """

    settings: Settings
    recipe: Recipe
    order: LaunchOptions
    accounts: Path
    plant: str = ""
    secure: bool = False
    host_names: frozenset[str] | None = None
    monotonic_s: Callable[[], float] = time.monotonic
    over: bool = False
    sessions: Sessions = field(init=False)
    login_throttle: LoginThrottle = field(init=False)
    journal: Journal = field(init=False)
    runs: RunLauncher = field(init=False)
    queue: LoadQueue = field(init=False)
    hashing: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(2))
    password_turns: FairTurns = field(default_factory=FairTurns)
    guesser_turns: FairTurns = field(default_factory=FairTurns)
    turned_away: int = 0
    _accounts_by_name: tuple[tuple[int, int, int], Mapping[str, Account]] = ((-1, 0, 0), MappingProxyType({}))
    memory: LineCache = field(default_factory=LineCache)
    screen: Screen = field(init=False)
    turn: Lock = field(default_factory=Lock)
    children: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.sessions = Sessions(self.monotonic_s)
        self.login_throttle = LoginThrottle(self.monotonic_s)
        self.journal = Journal(companion_file(self.order.database, Companion.JOURNAL))
        self.runs = RunLauncher(self.order)
        self.queue = LoadQueue(companion_file(self.order.database, Companion.QUEUE))
        self.screen = Screen(self.settings, self.recipe, self.runs, self.queue)

    @property
    def people(self) -> Mapping[str, Account]:
        """The accounts by name as their file says now. Errors: ConfigError."""
        try:
            stat = self.accounts.stat()
            stamp = (stat.st_ino, stat.st_mtime_ns, stat.st_size)
        except FileNotFoundError:
            stamp = (0, 0, 0)
        if stamp != self._accounts_by_name[0]:
            self._accounts_by_name = (stamp, load(self.accounts))
        return self._accounts_by_name[1]

    def offers(self, right: str) -> bool:
        """Whether the page has what this right is for: a plant's is read only."""
        return not self.plant or right in _RIGHTS_AT_PLANT

    def check_sealed(self, account: Account) -> None:
        """Errors: UsageError where the log has sealed another account under this name, or none. A plant seals none."""
        if self.plant:
            return
        check_sealed(account, self.accounts, known_seal(self.order.database))

    def log(self) -> LogReader:
        """The log, opened for one question. Errors: LogError; nothing was ever run where there is no file."""
        if self.plant:
            return open_log(self.plant)
        if not self.order.database.exists():
            raise LogError("log-not-yet", path=str(self.order.database))
        return open_log(self.order.database)
