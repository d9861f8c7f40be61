"""Attempt ids: UUID version 7 (RFC 9562, section 5.7), made here and never by a server, sorted by time."""

import secrets
import uuid


def uuid7(epoch_ns: int) -> str:
    """48 bits of milliseconds, 12 bits of the fraction of one (method 3), 62 random bits."""
    ms, rest_ns = divmod(max(epoch_ns, 0), 1_000_000)
    fraction = (rest_ns << 12) // 1_000_000
    value = (ms & (1 << 48) - 1) << 80 | 0x7 << 76 | fraction << 64 | 0b10 << 62 | secrets.randbits(62)
    return str(uuid.UUID(int=value))
