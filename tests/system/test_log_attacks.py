"""A short form of tests/endurance/log_attacks.py: whoever has the files, and even the key, is found and refused."""

from tests.conftest import SEED
from tests.endurance.log_attacks import ATTACKS, attack


def test_every_kind_of_attack_is_found_with_one_anchor_elsewhere_and_refused() -> None:
    rows = attack(2 * len(ATTACKS), SEED)
    assert {kind: row for kind, row in rows.items() if row != (2, 2, 2)} == {}
