"""Files of certificates that were issued: the log seals the SHA-256 of each, so that later versions know it again."""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

#: Kind of the event, under the attempt, that holds an issued file.
ISSUED = "certificate"
#: What a file may be.
FORMATS = ("pdf", "xml", "json", "wsjf")
_SHA256 = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True, slots=True)
class IssuedFile:
    """number: the certificate's; format: of FORMATS; sha256: of the file's bytes; issued: ISO date; software: version
    that made it."""

    number: str
    format: str
    sha256: str
    issued: str
    software: str

    @staticmethod
    def of(document: Mapping[str, Any]) -> "IssuedFile":
        """As an event holds it. Errors: KeyError, TypeError, ValueError where it is none."""
        found = IssuedFile(**{key: str(document[key]) for key in IssuedFile.__slots__})
        if found.format not in FORMATS or not _SHA256.fullmatch(found.sha256):
            raise ValueError(found.format)
        return found


def digest_of(content: bytes) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(content).hexdigest()


def issued_files(stored: Mapping[str, Any]) -> list[tuple[int, IssuedFile]]:
    """Every issued file of a stored attempt, oldest first, with the number of its record."""
    return [(int(e["record"]), IssuedFile.of(e["detail"])) for e in stored["events"] if e["kind"] == ISSUED]
