"""Files of certificates that were issued: the log seals the SHA-256 of each, so that later versions know it again."""

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

#: Kind of the event, under the attempt, that holds an issued file.
ISSUED = "certificate"
#: What a file may be.
FORMATS = ("pdf", "xml", "json", "wsjf")
#: How the events call what no log knows.
_OUTSIDE_LOG = "beside"
_SHA256 = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True, slots=True)
class IssuedFile:
    """number: the certificate's; format: of FORMATS; sha256: of the file's bytes; issued: ISO date; software: version
    that made it; outside_log: what it says that no log knows, as `digests_of` writes it, '' in older logs; changed:
    parts in which a person said that it differs from the one it replaces, where an older log does not know."""

    number: str
    format: str
    sha256: str
    issued: str
    software: str
    outside_log: str = ""
    changed: tuple[str, ...] = ()

    @staticmethod
    def of(document: Mapping[str, Any]) -> "IssuedFile":
        """As an event holds it. Errors: KeyError, TypeError, ValueError where it is none."""
        needed = ("number", "format", "sha256", "issued", "software")
        texts = {key: str(document[key]) for key in needed}
        changed = tuple(map(str, document.get("changed", ())))
        found = IssuedFile(**texts, outside_log=str(document.get(_OUTSIDE_LOG, "")), changed=changed)
        if found.format not in FORMATS or not _SHA256.fullmatch(found.sha256):
            raise ValueError(found.format)
        return found

    def document(self) -> dict[str, Any]:
        """As an event holds it."""
        found = asdict(self)
        found[_OUTSIDE_LOG] = found.pop("outside_log")
        return found if self.changed else {key: value for key, value in found.items() if key != "changed"}


@dataclass(frozen=True, slots=True)
class Edition:
    """Which certificate of an attempt it is (ISO/IEC 17025, 7.8.8): number, ISO date; replaces: the number of the one
    before it, '' for the first; changed: what the two differ in."""

    number: str
    issued: str
    replaces: str = ""
    changed: tuple[str, ...] = ()


def digests_of(parts: Mapping[str, Any]) -> str:
    """What a certificate says that no log knows, as one SHA-256 for each part: `customer=… signatory=…`."""
    texts = {key: json.dumps(value, sort_keys=True) for key, value in sorted(parts.items())}
    return " ".join(f"{key}={digest_of(text.encode())}" for key, text in texts.items())


def edition_for(known: Sequence[IssuedFile], first: str, outside_log: str, today: str) -> Edition:
    """The edition that says this: one that was issued already, or the next. known: all issued files, oldest first;
    first: number of an attempt's first certificate; outside_log: `digests_of`; today: ISO date."""
    for file in known:
        if file.outside_log == outside_log:
            return edition_of(known, file.number) or Edition(file.number, file.issued)
    numbers = _numbers(known)
    if not numbers:
        return Edition(first, today)
    return Edition(f"{first}-{len(numbers) + 1}", today, numbers[-1], _changed(known, numbers[-1], outside_log))


def edition_of(known: Sequence[IssuedFile], number: str) -> Edition | None:
    """The edition of that number as it was issued; None where there was none."""
    numbers, file = _numbers(known), next((f for f in known if f.number == number), None)
    if file is None:
        return None
    at = numbers.index(number)
    if at == 0:
        return Edition(number, file.issued)
    changed = _changed(known, numbers[at - 1], file.outside_log) or file.changed
    return Edition(number, file.issued, numbers[at - 1], changed)


def _numbers(known: Sequence[IssuedFile]) -> list[str]:
    return list(dict.fromkeys(file.number for file in known))


def _changed(known: Sequence[IssuedFile], replaced: str, outside_log: str) -> tuple[str, ...]:
    """Parts that differ from those of the replaced one; none where an older log does not keep them."""
    before = next(file.outside_log for file in known if file.number == replaced)
    return changed_parts(before, outside_log) if before else ()


def changed_parts(before: str, outside_log: str) -> tuple[str, ...]:
    """Names of the parts in which two differ, each as `digests_of` writes it."""
    old, new = (dict(part.split("=", 1) for part in text.split()) for text in (before, outside_log))
    return tuple(key for key in sorted({*old, *new}) if old.get(key) != new.get(key))


def digest_of(content: bytes) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(content).hexdigest()


def issued_files(stored: Mapping[str, Any]) -> list[tuple[int, IssuedFile]]:
    """Every issued file of a stored attempt, oldest first, with the number of its record."""
    return [(int(e["record"]), IssuedFile.of(e["detail"])) for e in stored["events"] if e["kind"] == ISSUED]
