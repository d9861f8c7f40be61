"""Merkle tree over the seals of a log: roots and consistency proofs (RFC 9162, sections 2.1.1 and 2.1.4).

The n-th leaf is the seal of record n. A proof shows that the tree of the first m records is a beginning of that of the
first n, in about log2(n) hashes, so that a witness need not keep the records to know that none was taken back.
"""

import hashlib
from collections.abc import Callable, Sequence

#: Hash of the leaves first … last − 1, counted from 0.
Subtree = Callable[[int, int], bytes]


def leaf_hash(seal: bytes) -> bytes:
    """HASH(0x00 ‖ seal)."""
    return hashlib.sha256(b"\x00" + seal).digest()


def node_hash(left: bytes, right: bytes) -> bytes:
    """HASH(0x01 ‖ left ‖ right)."""
    return hashlib.sha256(b"\x01" + left + right).digest()


class Tree:
    """The tree of a growing log. seals(first, count): those of records first + 1 …; whole subtrees are remembered."""

    def __init__(self, seals: Callable[[int, int], Sequence[bytes]]) -> None:
        self._seals = seals
        self._whole: dict[tuple[int, int], bytes] = {}

    def root(self, size: int) -> bytes:
        """The root over the first `size` records; of none, SHA-256 of nothing."""
        return self._subtree(0, size) if size else hashlib.sha256().digest()

    def proof(self, earlier: int, later: int) -> list[bytes]:
        """That the first `earlier` records are the beginning of the first `later`; 0 < earlier ≤ later."""
        return list(_subproof(earlier, 0, later, self._subtree, whole=True))

    def _subtree(self, first: int, last: int) -> bytes:
        known = self._whole.get((first, last))
        if known is not None:
            return known
        size = last - first
        found = self._leaves(first, last) if size <= _BLOCK else self._split(first, last)
        if size & (size - 1) == 0 and size >= _BLOCK:  # never changes again
            self._whole[first, last] = found
        return found

    def _split(self, first: int, last: int) -> bytes:
        middle = first + _largest_power_below(last - first)
        return node_hash(self._subtree(first, middle), self._subtree(middle, last))

    def _leaves(self, first: int, last: int) -> bytes:
        return root_of([leaf_hash(seal) for seal in self._seals(first, last - first)])


#: Leaves that are read at once; smaller subtrees are not remembered.
_BLOCK = 1024


def root_of(hashes: Sequence[bytes]) -> bytes:
    """The root over at least one hashed leaf."""
    if len(hashes) == 1:
        return hashes[0]
    middle = _largest_power_below(len(hashes))
    return node_hash(root_of(hashes[:middle]), root_of(hashes[middle:]))


def is_consistent(earlier: int, earlier_root: bytes, later: int, later_root: bytes, proof: Sequence[bytes]) -> bool:
    """Whether the proof shows that the earlier tree is a beginning of the later one (RFC 9162, 2.1.4.2)."""
    if earlier == later:
        return earlier_root == later_root and not proof
    if not 0 < earlier < later or not proof:
        return False
    steps = list(proof)
    if earlier & (earlier - 1) == 0:
        steps.insert(0, earlier_root)
    at, end = earlier - 1, later - 1
    while at & 1:
        at, end = at >> 1, end >> 1
    old = new = steps[0]
    for step in steps[1:]:
        if end == 0:
            return False
        if at & 1 or at == end:
            old, new = node_hash(step, old), node_hash(step, new)
            while not at & 1 and at:
                at, end = at >> 1, end >> 1
        else:
            new = node_hash(new, step)
        at, end = at >> 1, end >> 1
    return old == earlier_root and new == later_root and end == 0


def _subproof(m: int, first: int, last: int, subtree: Subtree, *, whole: bool) -> Sequence[bytes]:
    """SUBPROOF(m, D[first:last], whole) of RFC 9162, 2.1.4.1."""
    size = last - first
    if m == size:
        return [] if whole else [subtree(first, last)]
    k = _largest_power_below(size)
    if m <= k:
        return [*_subproof(m, first, first + k, subtree, whole=whole), subtree(first + k, last)]
    return [*_subproof(m - k, first + k, last, subtree, whole=False), subtree(first, first + k)]


def _largest_power_below(size: int) -> int:
    """The largest power of two below size, which is at least 2."""
    return 1 << (size - 1).bit_length() - 1
