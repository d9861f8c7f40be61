"""Which key signs which records of a log: the first one, and each that took its place by the old key's signature."""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from station.domain.records.chain import IntegrityFinding
from station.messages import Message

#: The kind of event by which a log names the key that signs it from there on.
KEY_EVENT = "signing-key"
#: The kind of event by which a key is no longer trusted beyond a record.
REVOKED_EVENT = "key-revoked"

#: A check of (public key, signature, statement).
Verify = Callable[[bytes, bytes, bytes], bool]


def rotation_statement(log_id: str, old: bytes, new: bytes) -> bytes:
    """What the old key signs to hand a log over to a new one."""
    return hashlib.sha256(f"station.key-rotation/1\n{log_id}\n{old.hex()}\n{new.hex()}".encode()).digest()


@dataclass(frozen=True, slots=True)
class KeyChange:
    """A record that names the key of the log from itself on. by_old: the old key's signature over it, or b""."""

    number: int
    key: bytes
    by_old: bytes = b""


@dataclass(frozen=True, slots=True)
class Revocation:
    """A key that is not trusted beyond a record."""

    key: bytes
    beyond: int


@dataclass(frozen=True, slots=True)
class KeySchedule:
    """changes: in the order of their numbers. trusted: a key known from elsewhere, 32 bytes, or None."""

    log_id: str
    changes: Sequence[KeyChange]
    revocations: Sequence[Revocation]
    verify: Verify
    trusted: bytes | None = None

    @property
    def signs(self) -> bool:
        """Whether any key is known."""
        return bool(self.changes) or self.trusted is not None

    def check(self, number: int, signature: bytes, seal: bytes) -> bool:
        """Whether the record's signature is of the key that was the log's then, and not revoked by then."""
        key = self.key_at(number)
        revoked = any(r.key == key and number > r.beyond for r in self.revocations)
        return key is not None and not revoked and self.verify(key, signature, seal)

    def key_at(self, number: int) -> bytes | None:
        """The key of a record; where the trusted one is none of the log's, that alone counts."""
        keys = [change.key for change in self.changes]
        if self.trusted is not None and self.trusted not in keys:
            return self.trusted
        named = [change.key for change in self.changes if change.number <= number]
        return named[-1] if named else keys[0] if keys else None

    def findings(self) -> Iterator[IntegrityFinding]:
        """Changes of key without the old key's word, where somebody trusts a key of the log."""
        if self.trusted is None or self.trusted not in [change.key for change in self.changes]:
            return
        for old, new in zip(self.changes, self.changes[1:], strict=False):
            statement = rotation_statement(self.log_id, old.key, new.key)
            if new.key != old.key and not (new.by_old and self.verify(old.key, new.by_old, statement)):
                what = Message("key-changed-unsigned", number=new.number, key=new.key.hex()[:16])
                yield IntegrityFinding("forged", "event", new.number, what)
