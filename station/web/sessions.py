"""Sessions that expire, CSRF tokens bound to them, and a limit on guesses. In memory: a restart logs everybody out."""

import hmac
import secrets
from collections.abc import Callable
from dataclasses import dataclass, field

from station.web.accounts import Account


@dataclass(frozen=True, slots=True)
class Session:
    """One person's visit: token of the cookie, token of the forms, and when it ends if nothing is done."""

    token: str
    csrf: str
    account: Account
    begun_s: float
    seen_s: float


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
        return now - session.seen_s < self.idle_s and now - session.begun_s < self.longest_s


def same_token(session: Session, given: str) -> bool:
    """Whether a form's token is this session's."""
    return hmac.compare_digest(session.csrf.encode(), given.encode())


@dataclass(slots=True)
class LoginThrottle:
    """Failed log-ins by key (name, and address): after `most` within `window_s`, no further try counts."""

    monotonic_s: Callable[[], float]
    most: int = 5
    window_s: float = 60.0
    _failed: dict[str, list[float]] = field(default_factory=dict)

    def wait_s(self, *keys: str) -> float:
        """Seconds until the next try is allowed; 0 when it is."""
        now = self.monotonic_s()
        self._failed = {
            k: fresh for k, v in self._failed.items() if (fresh := [t for t in v if now - t < self.window_s])
        }
        full = [v for k in keys if len(v := self._failed.get(k, [])) >= self.most]
        return max((self.window_s - (now - v[-self.most]) for v in full), default=0.0)

    def failed(self, *keys: str) -> None:
        """Counts one failed try against each key."""
        for key in keys:
            self._failed.setdefault(key, []).append(self.monotonic_s())

    def clear_failures(self, *keys: str) -> None:
        """A success clears the name."""
        for key in keys:
            self._failed.pop(key, None)
