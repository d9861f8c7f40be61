"""A witness of logs: it takes a head only if the log that it knew is the beginning of the log it is shown now."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from threading import Lock

from station.domain.records import merkle
from station.domain.records.tree_head import TreeHead, receipt_statement, replacement_statement
from station.ports.clock import Clock
from station.ports.tree_heads import TreeHeads

Verify = Callable[[bytes, bytes, bytes], bool]


class Refusal(StrEnum):
    """Why a head is not taken."""

    UNKNOWN_STATION = "unknown-station"
    FORGED = "forged"
    OTHER_KEY = "other-key"
    OTHER_LOG = "other-log"
    OLDER = "older"
    FORK = "fork"


@dataclass(frozen=True, slots=True)
class Receipt:
    """The witness' signature over a head and the time at which it saw it."""

    at_ns: int
    signature: bytes


@dataclass(frozen=True, slots=True)
class Replacement:
    """end: of the log that an engineer has taken note of as gone (TreeHead.end), "" where nothing is replaced;
    signature: the station's, in hex, over `replacement_statement`."""

    end: str = ""
    signature: str = ""


NOTHING_REPLACED = Replacement()


class Witness:
    """verify(key, signature, statement): a signature check. sign: the witness' own key. stations: keys by station name
    that alone are served; empty: whoever comes first with a name keeps it."""

    def __init__(
        self,
        heads: TreeHeads,
        clock: Clock,
        sign: Callable[[bytes], bytes],
        verify: Verify,
        stations: Mapping[str, bytes],
    ) -> None:
        self._heads, self._clock, self._sign, self._verify = heads, clock, sign, verify
        self._stations = stations
        self._turn = Lock()

    def newest(self, station: str) -> TreeHead | None:
        """The newest head of the log that the station kept last."""
        known = self._heads.of_station(station)
        return known[-1] if known else None

    def submit(
        self, head: TreeHead, earlier: int, proof: Sequence[bytes], *, replaces: Replacement = NOTHING_REPLACED
    ) -> Receipt | Refusal:
        """Takes a head that goes on from `earlier` records by a consistency proof. replaces: kept with the head.

        Errors: StoreFault.
        """
        with self._turn:
            if refusal := self._refusal(head, earlier, proof, replaces):
                return refusal
            at_ns = self._clock.epoch_ns()
            self._heads.append(head, at_ns, replaces.end)
        return Receipt(at_ns, self._sign(receipt_statement(head, at_ns)))

    def _refusal(self, head: TreeHead, earlier: int, proof: Sequence[bytes], replaces: Replacement) -> Refusal | None:
        key = bytes.fromhex(head.public_key)
        if self._stations and self._stations.get(head.station) != key:
            return Refusal.UNKNOWN_STATION
        signed = [(head.signature, head.statement()), (head.record_signature, bytes.fromhex(head.seal))]
        if replaces.end:
            signed.append((replaces.signature, replacement_statement(head, replaces.end)))
        if not all(self._verify(key, bytes.fromhex(signature), statement) for signature, statement in signed):
            return Refusal.FORGED
        known = self._heads.of_station(head.station)
        if known and known[-1].public_key != head.public_key:
            return Refusal.OTHER_KEY
        if not known or known[-1].end == replaces.end:
            return None
        own = next((k for k in known if k.log_id == head.log_id), None)
        return _of_one_log(own, head, earlier, proof) if own else Refusal.OTHER_LOG


def _of_one_log(known: TreeHead, head: TreeHead, earlier: int, proof: Sequence[bytes]) -> Refusal | None:
    if head.size < known.size:
        return Refusal.OLDER
    if earlier != known.size:
        return Refusal.FORK
    roots = bytes.fromhex(known.root), bytes.fromhex(head.root)
    return None if merkle.is_consistent(known.size, roots[0], head.size, roots[1], proof) else Refusal.FORK
