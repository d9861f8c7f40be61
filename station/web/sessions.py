"""Sessions that expire, CSRF tokens bound to them, and a limit on guesses. In memory: a restart logs everybody out."""

import hmac
import secrets
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from station.panel_protocol.accounts import Account

#: Beyond so many names and addresses, those without a recent failure are forgotten.
_MOST_KEYS = 10_000


@dataclass(frozen=True, slots=True)
class Session:
    """One person's visit: token of the cookie, token of the forms, and when it ends if nothing is done."""

    token: str
    csrf: str
    account: Account
    begun_s: float
    last_used_s: float


@dataclass(slots=True)
class Sessions:
    """Open sessions. idle_s, longest_s: how long without a request, and in all. monotonic_s: the clock."""

    monotonic_s: Callable[[], float]
    idle_s: float = 3600.0
    longest_s: float = 12 * 3600.0
    _open: dict[str, Session] = field(default_factory=dict)

    def begin(self, account: Account) -> Session:
        """A new session with fresh tokens; what has expired is swept out."""
        now = self.monotonic_s()
        self._open = {t: s for t, s in self._open.items() if self._alive(s, now)}
        session = Session(secrets.token_urlsafe(32), secrets.token_urlsafe(32), account, now, now)
        self._open[session.token] = session
        return session

    def find(self, token: str | None) -> Session | None:
        """The live session of a cookie, kept alive by being asked for; None when there is none."""
        session = self._open.get(token or "")
        now = self.monotonic_s()
        if session is None or not self._alive(session, now):
            self._open.pop(token or "", None)
            return None
        session = Session(session.token, session.csrf, session.account, session.begun_s, now)
        self._open[session.token] = session
        return session

    def open(self, token: str) -> bool:
        """Whether the session still lives; asking does not keep it alive."""
        session = self._open.get(token)
        return session is not None and self._alive(session, self.monotonic_s())

    def end(self, token: str) -> None:
        """Logs out."""
        self._open.pop(token, None)

    def _alive(self, session: Session, now: float) -> bool:
        return now - session.last_used_s < self.idle_s and now - session.begun_s < self.longest_s


def same_token(session: Session, given: str) -> bool:
    """Whether a form's token is this session's."""
    return hmac.compare_digest(session.csrf.encode(), given.encode())


@dataclass(slots=True)
class LoginThrottle:
    """Failed log-ins by key (name, and address). Whoever has failed `most` times within `window_s` is a guesser: tries
    by such a name or from such an address are checked one after the other, and a wrong one is answered late. None is
    refused unchecked: the right password always opens, whoever else tries."""

    monotonic_s: Callable[[], float]
    most: int = 5
    window_s: float = 60.0
    longest_delay_s: float = 2.0
    _failed: dict[str, deque[float]] = field(default_factory=dict)

    def guessing(self, *keys: str) -> bool:
        """Whether any of the keys belongs to a guesser."""
        return any(self._recent(key) >= self.most for key in keys)

    def delay_s(self, *keys: str) -> float:
        """How much later than at once a wrong try is answered: doubled with every failure beyond `most`."""
        beyond = max(self._recent(key) for key in keys) - self.most
        return 0.0 if beyond < 0 else min(0.25 * 2.0 ** min(beyond, 10), self.longest_delay_s)

    def failed(self, *keys: str) -> None:
        """Counts one failed try against each key; only so many are remembered as make a difference."""
        if len(self._failed) > _MOST_KEYS:
            self._failed = {key: tries for key, tries in self._failed.items() if self._recent(key)}
        for key in keys:
            self._failed.setdefault(key, deque(maxlen=self.most + 10)).append(self.monotonic_s())

    def _recent(self, key: str) -> int:
        tries, since_s = self._failed.get(key, ()), self.monotonic_s() - self.window_s
        return sum(at_s > since_s for at_s in tries)

    def clear_failures(self, *keys: str) -> None:
        """A success clears the name."""
        for key in keys:
            self._failed.pop(key, None)
