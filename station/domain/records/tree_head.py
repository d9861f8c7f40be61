"""A signed tree head: what a station tells a witness of its log, and what the witness signs in return."""

import hashlib
from dataclasses import asdict, dataclass
from typing import Any

SCHEMA = "station.tree-head/1"


@dataclass(frozen=True, slots=True)
class TreeHead:
    """log_id, station: whose log; size: records; root: Merkle root over their seals; seal: that of the last one;
    record_signature: the last record's own; public_key: the station's; signature: over `statement()`; all in hex."""

    log_id: str
    station: str
    size: int
    root: str
    seal: str
    record_signature: str
    public_key: str
    signature: str = ""

    @property
    def end(self) -> str:
        """The log and its end at this head, as `replaces` names them."""
        return log_end(self.log_id, self.size, self.seal)

    def statement(self) -> bytes:
        """What the station signs."""
        parts = (SCHEMA, self.log_id, self.station, str(self.size), self.root, self.seal, self.public_key)
        return hashlib.sha256("\n".join(parts).encode()).digest()

    def document(self) -> dict[str, Any]:
        """As it goes over the wire."""
        return {"schema": SCHEMA} | asdict(self)

    @staticmethod
    def of(document: dict[str, Any]) -> "TreeHead":
        """The head of such a document. Errors: ValueError."""
        try:
            texts = {name: str(document[name]) for name in _TEXTS}
            size = int(document["size"])
            lengths = [len(bytes.fromhex(texts[name])) for name in _HEX]
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise ValueError("no tree head") from error
        if document.get("schema") != SCHEMA or size < 1 or lengths != [32, 32, 64, 32, 64]:
            raise ValueError("no tree head")
        if not all(0 < len(texts[name]) <= 64 and texts[name].isprintable() for name in ("log_id", "station")):
            raise ValueError("no tree head")
        return TreeHead(size=size, **texts)


_HEX = ("root", "seal", "record_signature", "public_key", "signature")
_TEXTS = ("log_id", "station", *_HEX)


def log_end(log_id: str, size: int, seal: str) -> str:
    """A log up to a record, whose seal is in hex."""
    return f"{log_id}:{size}:{seal}"


def replacement_statement(head: TreeHead, replaces: str) -> bytes:
    """What the station signs when a head takes the place of another log's end: whoever only saw a head go by cannot say
    so, and the words hold for that end alone."""
    return hashlib.sha256(f"station.replaces/1\n{replaces}\n".encode() + head.statement()).digest()


def receipt_statement(head: TreeHead, at_ns: int) -> bytes:
    """What a witness signs: the head's statement, and when it saw it."""
    return hashlib.sha256(head.statement() + str(at_ns).encode()).digest()


#: Event of a log that holds a witness' receipt: place, size, root, at_ns, signature.
WITNESSED_EVENT = "witnessed"


@dataclass(frozen=True, slots=True)
class WitnessReceipt:
    """A witness' signature, in hex, over the head of so many records that it saw at a time."""

    size: int
    root: str
    at_ns: int
    signature: str
