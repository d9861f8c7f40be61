"""The station's Ed25519 key (RFC 8032): signs each record's seal, so that nobody without it can rebuild the chain.

Made by `openssl genpkey -algorithm ed25519 -out station.key`; the public half for auditors by
`openssl pkey -in station.key -pubout -out station.pub`.
"""

import sqlite3
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from station.domain.records import key_schedule
from station.domain.records.head import AnchorFinding
from station.domain.records.json_object import json_object
from station.domain.records.key_schedule import KeyChange, KeySchedule, Revocation
from station.errors import ConfigError, UsageError
from station.messages import Message, system_reason

KEY_EVENT, REVOKED_EVENT = key_schedule.KEY_EVENT, key_schedule.REVOKED_EVENT


@dataclass(frozen=True, slots=True)
class Signer:
    """Signs a seal; public_key: 32 bytes."""

    sign: Callable[[bytes], bytes]
    public_key: bytes


def load_signer(path: Path, passphrase: bytes | None = None) -> Signer:
    """The station's key from a PEM file, which may be encrypted. Errors: ConfigError."""
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    try:
        data = path.read_bytes()
        encrypted = b"ENCRYPTED" in data
        key = load_pem_private_key(data, passphrase if encrypted else None)
    except (OSError, ValueError, TypeError, UnsupportedAlgorithm) as exc:
        if isinstance(exc, FileNotFoundError):
            raise ConfigError("station-key-missing", path=str(path)) from exc
        if isinstance(exc, OSError):
            raise ConfigError("file-unreadable", file=str(path), why=system_reason(exc)) from exc
        if not encrypted:
            raise ConfigError("station-key-unreadable", path=str(path)) from exc
        raise ConfigError("station-key-passphrase", path=str(path)) from exc
    if not isinstance(key, Ed25519PrivateKey):
        raise ConfigError("key-other-kind", path=str(path))
    return Signer(key.sign, key.public_key().public_bytes_raw())


def load_public_key(path: Path) -> bytes:
    """A public key, 32 bytes, from the PEM file of either half. Errors: UsageError."""
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key, load_pem_public_key

    try:
        data = path.read_bytes()
        key = load_pem_private_key(data, None).public_key() if b"PRIVATE" in data else load_pem_public_key(data)
    except OSError as exc:
        raise UsageError("file-unreadable", file=str(path), why=system_reason(exc)) from exc
    except (ValueError, TypeError, UnsupportedAlgorithm) as exc:
        raise UsageError("public-key-unreadable", path=str(path)) from exc
    if not isinstance(key, Ed25519PublicKey):
        raise UsageError("key-other-kind", path=str(path))
    return key.public_bytes_raw()


def signature_verifier(key: bytes) -> Callable[[bytes, bytes], bool]:
    """A check of (signature, seal) by a public key of 32 bytes."""
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    public_key = Ed25519PublicKey.from_public_bytes(key)

    def check(signature: bytes, seal: bytes) -> bool:
        try:
            public_key.verify(signature, seal)
        except InvalidSignature:
            return False
        return True

    return check


def verify(key: bytes, signature: bytes, statement: bytes) -> bool:
    """Whether the signature over a statement is of that public key, 32 bytes."""
    return len(key) == 32 and signature_verifier(key)(signature, statement)


def named_public_key(db: sqlite3.Connection) -> bytes | None:
    """The public key that a log names as its own; None for a log that is not signed, or whose naming is spoilt."""
    try:
        key = bytes.fromhex(_named(db)["public_key"])
    except (ValueError, KeyError, TypeError):
        return None
    return key if len(key) == 32 else None


def schedule(db: sqlite3.Connection, log_id: str, trusted: bytes | None = None) -> KeySchedule:
    """Which key signs which records, by the log's own events; trusted: a key known from elsewhere, 32 bytes."""
    changes = [
        KeyChange(number, bytes.fromhex(detail["public_key"]), bytes.fromhex(detail.get("by_old", "")))
        for number, detail in _events(db, KEY_EVENT, "public_key")
    ]
    revoked = [
        Revocation(bytes.fromhex(detail["public_key"]), int(detail["beyond"]))
        for _, detail in _events(db, REVOKED_EVENT, "public_key")
    ]
    return KeySchedule(log_id, changes, revoked, verify, trusted)


def _events(db: sqlite3.Connection, kind: str, key: str) -> list[tuple[int, dict[str, Any]]]:
    """Events of a kind that name a key of 32 bytes, oldest first; spoilt ones show in the chain."""
    found = list[tuple[int, dict[str, Any]]]()
    query = "SELECT seq, detail FROM event WHERE attempt IS NULL AND kind = ? ORDER BY seq"
    for number, text in db.execute(query, (kind,)):
        with suppress(ValueError, KeyError, TypeError):
            detail = json_object(text)
            if len(bytes.fromhex(detail[key])) == 32 and bytes.fromhex(detail.get("by_old", "")) is not None:
                found.append((number, detail))
    return found


def signs_heads(db: sqlite3.Connection) -> bool:
    """Whether the log's heads are signed, as its records are; version 0.1 signed records alone."""
    return _named(db).get("heads") is True


def _named(db: sqlite3.Connection) -> dict[str, Any]:
    query = "SELECT detail FROM event WHERE attempt IS NULL AND kind = ? ORDER BY seq DESC LIMIT 1"
    row = db.execute(query, (KEY_EVENT,)).fetchone()
    try:
        return json_object(row[0]) if row else {}
    except ValueError:
        return {}


def check_signer(db: sqlite3.Connection, signer: Signer | None, old: Signer | None) -> list[AnchorFinding]:
    """What the log's named key says against the station's: another one without the old one's word, or none at all."""
    named = named_public_key(db)
    if named is None or (signer and signer.public_key == named) or (signer and old and old.public_key == named):
        return []
    what = "key-changed" if signer else "key-left-out"
    number = max((number for number, _ in _events(db, KEY_EVENT, "public_key")), default=0)
    return [AnchorFinding(what, "signing_key", number, Message(what, key=named.hex()[:16]))]
