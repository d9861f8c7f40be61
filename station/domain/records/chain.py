"""The chain of hashes: each record seals the one before, so that no edit of the log goes unnoticed.

hash(n) = SHA-256(hash(n−1) ‖ kind, fields and values of record n), hash(0) = SHA-256(schema ‖ log id).
Records are numbered 1, 2, 3 … over all tables. A field that is null is left out of the sealed bytes, so a
later schema may add fields without breaking old seals.
"""

import hashlib
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from station.messages import Message, render

Value = int | float | str | bytes | None

SCHEMA = "station.log/1"


def genesis(log_id: str) -> bytes:
    """hash(0) of a log: two logs never share a record, so none can be moved from one to the other."""
    return hashlib.sha256(f"{SCHEMA}\n{log_id}".encode()).digest()


def canonical(kind: str, names: Sequence[str], values: Sequence[Value]) -> bytes:
    """The bytes that are sealed: kind, then name, type, length and value of each field that is not null.

    Lengths stand before values, so two different records never give the same bytes.
    """
    parts = [b"%d:%b" % (len(kind), kind.encode())]
    plain = ""  # what is ASCII becomes bytes in one go
    for name, value in zip(names, values, strict=True):
        if type(value) is int:
            digits = str(value)
            plain += f"{name}=i{len(digits)}:{digits}"
        elif type(value) is str and value.isascii():
            plain += f"{name}=s{len(value)}:{value}"
        elif value is not None:
            tag, body = _encoded(value)
            parts += plain.encode(), b"%b=%b%d:" % (name.encode(), tag, len(body)), body
            plain = ""
    parts.append(plain.encode())
    return b"".join(parts)


def _encoded(value: Value) -> tuple[bytes, bytes]:
    """Type and bytes of a value. Errors: TypeError for what no record can hold."""
    if type(value) is str:
        return b"s", value.encode("utf-8", "surrogateescape")
    if type(value) is float:
        return b"f", struct.pack(">d", value)
    if type(value) is bytes:
        return b"b", value
    raise TypeError(f"the log cannot keep a {type(value).__name__}")


def link(previous: bytes, body: bytes) -> bytes:
    """hash(n) from hash(n−1) and the canonical bytes of record n."""
    return hashlib.sha256(previous + body).digest()


@dataclass(frozen=True, slots=True)
class SealedRecord:
    """A record as found in a log: its number, table, stored seals and the bytes they should be seals of."""

    number: int
    kind: str
    previous: bytes
    hash: bytes
    body: bytes
    signature: bytes | None = None


@dataclass(frozen=True, slots=True)
class IntegrityFinding:
    """One thing wrong with the log. what: edited | deleted | inserted | reordered | truncated | unsigned | …"""

    what: str
    kind: str
    number: int
    message: Message

    @property
    def sentence(self) -> str:
        """What is wrong, in English."""
        return render(self.message)

    def document(self) -> dict[str, object]:
        """As `audit --verify --json` prints it."""
        head = {"what": self.what, "kind": self.kind, "number": self.number, "sentence": self.sentence}
        return head | {"message": self.message.document()}


@dataclass(slots=True)
class ChainVerifier:
    """Walks a log's records in order of their numbers and yields what is wrong; memory does not grow.

    anchors: number → hash known from elsewhere (head row, head file, a printed certificate). After `run`, number
    and hash are those of the last record.
    verify: checks (number, signature, hash) of a record; None: this log has no key, so a signature is itself a finding.
    """

    start: bytes
    anchors: Mapping[int, bytes] = field(default_factory=dict)
    verify: Callable[[int, bytes, bytes], bool] | None = None
    number: int = 0
    hash: bytes = b""
    signed: bool = False
    _sealable: tuple[bytes, ...] = ()

    def run(self, records: Iterable[SealedRecord]) -> Iterator[IntegrityFinding]:
        """Findings of all records, which come sorted by number."""
        for record in records:
            yield from self.step(record)

    def step(self, r: SealedRecord) -> Iterator[IntegrityFinding]:
        """Findings of the next record."""
        if not self.number:
            self.hash, self._sealable = self.start, (self.start,)
        if r.number == self.number or r.number < 1:
            yield _finding("inserted", "record-number-twice", r)
            return
        gap = r.number > self.number + 1
        if gap:
            yield _missing(self.number + 1, r.number - 1)
        expected = link(r.previous, r.body)
        if expected != r.hash:
            yield _finding("edited", "record-edited", r)
        elif not gap and r.previous not in self._sealable:
            yield _finding("reordered", "record-moved", r)
        yield from self._signature(r)
        yield from self._anchor(r)
        self.number, self.hash, self._sealable = r.number, r.hash, (r.hash, expected)

    def _signature(self, r: SealedRecord) -> Iterator[IntegrityFinding]:
        """The first signed record seals all before it; from there on every record must be signed."""
        if r.signature is None:
            if self.signed:
                yield _finding("unsigned", "record-signature-lost", r)
            return
        self.signed = True
        if self.verify is None or not self.verify(r.number, r.signature, r.hash):
            yield _finding("forged", "record-forged", r)

    def _anchor(self, r: SealedRecord) -> Iterator[IntegrityFinding]:
        seal = self.anchors.get(r.number)
        if seal is not None and seal != r.hash:
            yield _finding("replaced", "record-replaced", r)


def _missing(first: int, last: int) -> IntegrityFinding:
    if first == last:
        return IntegrityFinding("deleted", "", first, Message("record-missing", number=first))
    return IntegrityFinding("deleted", "", first, Message("records-missing", first=first, last=last))


def _finding(what: str, id_: str, r: SealedRecord) -> IntegrityFinding:
    return IntegrityFinding(what, r.kind, r.number, Message(id_, kind=r.kind, number=r.number))


def check_tail(last: int, anchors: Mapping[int, bytes]) -> Iterator[IntegrityFinding]:
    """What the anchors say about the end of the log: records that once were and no longer are."""
    beyond = max((n for n in anchors if n > last), default=0)
    if beyond:
        yield IntegrityFinding("truncated", "", last + 1, Message("records-cut-off", last=last, reached=beyond))
