"""The tree of RFC 9162: known answers of its reference implementation, and every proof against every change."""

import hashlib

import hypothesis.strategies as st
import pytest
from hypothesis import given

from station.domain.records import merkle
from station.domain.records.merkle import Tree, is_consistent

#: The eight leaves and roots of the reference test of Certificate Transparency (merkle_tree_test).
LEAVES = [bytes.fromhex(x) for x in ("", "00", "10", "2021", "3031", "40414243", "5051525354555657",
                                     "606162636465666768696a6b6c6d6e6f")]  # fmt: skip
ROOTS = [
    "6e340b9cffb37a989ca544e6bb780a2c78901d3fb33738768511a30617afa01d",
    "fac54203e7cc696cf0dfcb42c92a1d9dbaf70ad9e621f4bd8d98662f00e3c125",
    "aeb6bcfe274b70a14fb067a5e5578264db0fa9b51af5e0ba159158f329e06e77",
    "d37ee418976dd95753c1c73862b9398fa2a2cf9b4ff0fdfe8b30cd95209614b7",
    "4e3bbb1f7b478dcfe71fb631631519a3bca12c9aefca1612bfce4c13a86264d4",
    "76e67dadbcdf1e10e1b74ddc608abd2f98dfb16fbce75277b5232a127f2087ef",
    "ddb89be403809e325750d3d263cd78929c2942b7942a34b77e122c9594a74c8c",
    "5dc9da79a70659a9ad559cb701ded9a2ab9d823aad2f4960cfe370eff4604328",
]


def tree(leaves: list[bytes]) -> Tree:
    return Tree(lambda first, count: leaves[first : first + count])


@pytest.mark.parametrize("size", range(1, 9))
def test_known_roots(size: int) -> None:
    assert tree(LEAVES).root(size).hex() == ROOTS[size - 1]


def test_known_proofs() -> None:
    hashes = [merkle.leaf_hash(leaf) for leaf in LEAVES]
    assert [p.hex() for p in tree(LEAVES).proof(1, 1)] == []
    assert [p.hex() for p in tree(LEAVES).proof(6, 8)] == [
        "0ebc5d3437fbe2db158b9f126a1d118e308181031d0a949f8dededebc558ef6a",
        "ca854ea128ed050b41b35ffc1b87b8eb2bde461e9e3b5596ece6b9d5975a0ae0",
        "d37ee418976dd95753c1c73862b9398fa2a2cf9b4ff0fdfe8b30cd95209614b7",
    ]
    assert tree(LEAVES).proof(2, 5) == [merkle.node_hash(hashes[2], hashes[3]), hashes[4]]


@pytest.mark.parametrize("later", range(1, 34))
def test_every_proof_holds_and_no_other_root_fits(later: int) -> None:
    seals = [hashlib.sha256(bytes([n])).digest() for n in range(later)]
    made = tree(seals)
    for earlier in range(1, later + 1):
        proof = made.proof(earlier, later)
        assert is_consistent(earlier, made.root(earlier), later, made.root(later), proof)
        assert not is_consistent(earlier, bytes(32), later, made.root(later), proof)
        assert not is_consistent(earlier, made.root(earlier), later, bytes(32), proof)
        if proof:
            assert not is_consistent(earlier, made.root(earlier), later, made.root(later), proof[:-1])
            assert not is_consistent(earlier, made.root(earlier), later, made.root(later), [*proof, bytes(32)])


@given(st.integers(1, 6000), st.integers(0, 6000), st.integers(0, 5999))
def test_a_record_changed_among_the_earlier_ones_is_always_seen(earlier: int, more: int, changed: int) -> None:
    later = earlier + more
    seals = [n.to_bytes(32) for n in range(later)]
    forked = list(seals)
    forked[changed % earlier] = b"\xff" * 32
    proof = tree(forked).proof(earlier, later)
    assert not is_consistent(earlier, tree(seals).root(earlier), later, tree(forked).root(later), proof)


def test_a_tree_that_grows_gives_the_roots_of_a_new_one() -> None:
    seals = [n.to_bytes(32) for n in range(5000)]
    growing = tree(seals)
    for size in (1, 1023, 1024, 1025, 2048, 3000, 4096, 4097, 5000):
        assert growing.root(size) == merkle.root_of([merkle.leaf_hash(s) for s in seals[:size]])
