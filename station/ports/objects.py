"""A store of bytes by their SHA-256: what has a name there never changes."""

from typing import Protocol


class ObjectStore(Protocol):
    """Errors: StoreFault where the store cannot be reached; LogError for what it does not hold."""

    def put(self, data: bytes) -> bytes:
        """Keeps the bytes, once; their SHA-256. When this returns, they are durable."""

    def get(self, sha256: bytes) -> bytes:
        """The bytes, checked against their name."""

    def remove(self, sha256: bytes) -> None:
        """Forgets the bytes; what is not there is no error."""
