"""Who may do what: accounts with scrypt-hashed passwords and a role each, kept in one JSON file."""

import base64
import hashlib
import hmac
import json
import secrets
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from station.errors import ConfigError, UsageError
from station.files.json_text import NOT_AS_EXPECTED, read_json, unread_reason
from station.files.replace import replace_text
from station.messages import system_reason

#: RFC 7914 and OWASP's floor: N = 2¹⁷, r = 8, p = 1, about 0.2 s and 128 MiB for one guess.
_N, _R, _P = 2**17, 8, 1


MAX_LENGTH = 200
_LONGEST_NAME = 64
#: Small letters of Cyrillic and Greek that look like Latin ones, as capitals or as they are; l and 1, o and 0.
_LIKE_LATIN = str.maketrans("аеорсухіјѕԁһԛԝвкмнтαορτυνικχ10", "aeopcyxijsdhqwbkmhtaoptuvikxlo")


class Role(StrEnum):
    """What a person may do; each role stands for its own rights, none contains another by magic."""

    OPERATOR = "operator"
    ENGINEER = "engineer"
    AUDITOR = "auditor"


#: Right → the roles that have it.
RIGHTS = {
    "watch": frozenset(Role),
    "run": frozenset({Role.OPERATOR, Role.ENGINEER}),
    "audit": frozenset({Role.AUDITOR, Role.ENGINEER}),
    "charts": frozenset({Role.AUDITOR, Role.ENGINEER}),
    "again": frozenset({Role.ENGINEER}),
    "diagnose": frozenset({Role.ENGINEER}),
    "sign": frozenset({Role.AUDITOR, Role.ENGINEER}),
}


@dataclass(frozen=True, slots=True)
class Account:
    """One person: name, role, and the hash of the password."""

    name: str
    role: Role
    password: str

    def may(self, right: str) -> bool:
        """Whether this person has the right."""
        return self.role in RIGHTS[right]


def hash_password(password: str) -> str:
    """`scrypt$N$r$p$salt$key`, salt and key in base64."""
    if not 8 <= len(password) <= MAX_LENGTH:
        raise UsageError("password-length", limit=MAX_LENGTH)
    salt = secrets.token_bytes(16)
    key = _scrypt(password, salt, _N, _R, _P)
    return f"scrypt${_N}${_R}${_P}${_b64(salt)}${_b64(key)}"


def verify_password(password: str, stored_hash: str) -> bool:
    """Whether the password is the kept one, in time that does not tell how nearly."""
    try:
        _, n, r, p, salt, key = stored_hash.split("$")
        found = _scrypt(password, base64.b64decode(salt), int(n), int(r), int(p))
        return hmac.compare_digest(found, base64.b64decode(key))
    except ValueError:
        return False


#: Verified when the name is unknown, so that the answer takes as long as for a known one.
DUMMY_HASH = f"scrypt${_N}${_R}${_P}${base64.b64encode(bytes(16)).decode()}${base64.b64encode(bytes(64)).decode()}"


def check_name(name: str, others: Iterable[str]) -> None:
    """Errors: UsageError for what is no name, or could be taken for one of the others on a page or a certificate."""
    if not name.isprintable() or not 0 < len(name) <= _LONGEST_NAME or name != " ".join(name.split()):
        raise UsageError("panel-name-form")
    for other in others:
        if other != name and _outline(other) == _outline(name):
            raise UsageError("panel-name-lookalike", name=name, other=other)


def _outline(name: str) -> str:
    """How a name looks at a glance: without case, marks, blanks and the width or script of its letters."""
    plain = unicodedata.normalize("NFKD", unicodedata.normalize("NFKD", name).casefold())
    return "".join(c for c in plain if c.isalnum()).translate(_LIKE_LATIN)


def load(path: Path) -> dict[str, Account]:
    """The accounts in the file by name; none where there is no file. ConfigError when it cannot be read."""
    if not path.exists():
        return {}
    try:
        rows = read_json(path)["accounts"]
        return {str(r["name"]): Account(str(r["name"]), Role(r["role"]), str(r["password"])) for r in rows}
    except (OSError, *NOT_AS_EXPECTED) as exc:
        raise ConfigError("accounts-unreadable", file=str(path), why=unread_reason(exc)) from exc


def save(path: Path, accounts: dict[str, Account]) -> None:
    """Writes the file whole or not at all, readable by its owner only. Errors: ConfigError."""
    rows = [{"name": a.name, "role": a.role.value, "password": a.password} for a in accounts.values()]
    text = json.dumps({"schema": "station.accounts/1", "accounts": rows}, indent=1)
    try:
        replace_text(path, text, durable=True, mode=0o600)
    except OSError as exc:
        raise ConfigError("accounts-not-written", file=str(path), why=system_reason(exc)) from exc


def _scrypt(password: str, salt: bytes, n: int, r: int, p: int) -> bytes:
    return hashlib.scrypt(password.encode(), salt=salt, n=n, r=r, p=p, maxmem=256 * n * r, dklen=64)


def _b64(data: bytes) -> str:
    return base64.b64encode(data).decode()
