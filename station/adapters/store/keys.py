"""The station's Ed25519 key (RFC 8032): signs each record's seal, so that nobody without it can rebuild the chain.

Made by `openssl genpkey -algorithm ed25519 -out station.key`; the public half for auditors by
`openssl pkey -in station.key -pubout -out station.pub`.
"""

import json
import sqlite3
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from station.errors import ConfigError, UsageError

#: The kind of event by which a log names the key that signs it from there on.
KEY_EVENT = "signing-key"


@dataclass(frozen=True, slots=True)
class Signer:
    """Signs a seal; public_key: 32 bytes."""

    sign: Callable[[bytes], bytes]
    public_key: bytes


def load_signer(path: Path) -> Signer:
    """The station's key from a PEM file. Errors: ConfigError."""
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    try:
        key = load_pem_private_key(path.read_bytes(), None)
    except (OSError, ValueError, TypeError) as exc:
        raise ConfigError("station-key-unreadable", path=str(path)) from exc
    if not isinstance(key, Ed25519PrivateKey):
        raise ConfigError("key-other-kind", path=str(path))
    return Signer(key.sign, key.public_key().public_bytes_raw())


def load_public_key(path: Path) -> bytes:
    """A public key, 32 bytes, from the PEM file of either half. Errors: UsageError."""
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key, load_pem_public_key

    try:
        data = path.read_bytes()
        key = load_pem_private_key(data, None).public_key() if b"PRIVATE" in data else load_pem_public_key(data)
    except (OSError, ValueError, TypeError) as exc:
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


def signs_heads(db: sqlite3.Connection) -> bool:
    """Whether the log's heads are signed, as its records are; version 0.1 signed records alone."""
    return _named(db).get("heads") is True


def _named(db: sqlite3.Connection) -> dict[str, Any]:
    query = "SELECT detail FROM event WHERE attempt IS NULL AND kind = ? ORDER BY seq DESC LIMIT 1"
    row = db.execute(query, (KEY_EVENT,)).fetchone()
    try:
        detail = json.loads(row[0]) if row else {}
    except ValueError:
        return {}
    return detail if isinstance(detail, dict) else {}
