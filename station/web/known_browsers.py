"""Browsers in which a person has logged in before: their log-ins do not wait behind somebody's guesses.

As OWASP's device cookies do it: the mark is a random number with a MAC by the stored form of the person's password, so
that nobody makes one without the accounts' file, a new password ends it, and nothing of it is kept at the station.
"""

import hashlib
import hmac
import secrets
from collections.abc import Mapping

from station.panel_protocol.accounts import Account

#: A browser is known for a year after the last log-in.
LASTS_S = 365 * 86_400


def mark_cookie(name: str) -> str:
    """The cookie's name: each person has their own, for several share a browser."""
    return f"station_browser_{hashlib.sha256(name.encode()).hexdigest()[:16]}"


def new_mark(account: Account) -> str:
    """What the cookie of this person holds from here on."""
    nonce = secrets.token_hex(16)
    return f"{nonce}.{_mac(account, nonce)}"


def known_browser(cookies: Mapping[str, str], account: Account | None) -> str:
    """What sets the browser apart in which this person has logged in before; "" for any other."""
    if account is None:
        return ""
    nonce, _, mac = cookies.get(mark_cookie(account.name), "").partition(".")
    return nonce if hmac.compare_digest(mac.encode(), _mac(account, nonce).encode()) else ""


def _mac(account: Account, nonce: str) -> str:
    statement = f"station.browser/1\n{account.name}\n{nonce}"
    return hmac.new(account.password.encode(), statement.encode(), hashlib.sha256).hexdigest()
