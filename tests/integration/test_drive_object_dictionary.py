"""What the station writes into a drive stands in a public object dictionary, with the same length and sign."""

import configparser
from pathlib import Path

import pytest

from station.domain.rig import drive_profile as profile
from tests.fakes.driven_rig import frames_of_a_life

#: CiA 301, table 44: data type → bytes, negative where it is signed.
TYPES = {2: -1, 3: -2, 4: -4, 5: 1, 6: 2, 7: 4}
#: Objects that this drive does not have, though the profile knows them: its maker left them out.
ABSENT = {0x6007, 0x603F, 0x6066}


@pytest.fixture(scope="module")
def dictionary(reference_data: Path) -> dict[tuple[int, int], int]:
    """(index, sub-index) → bytes of ros2_canopen's CiA 402 slave."""
    parser = configparser.ConfigParser(strict=False)
    parser.read(reference_data / "eds_public" / "ros2_canopen" / "cia402_slave.eds")
    found = {}
    for section in parser.sections():
        index, _, sub = section.lower().partition("sub")
        if len(index) == 4 and "datatype" in parser[section]:
            kind = int(parser[section]["datatype"], 0)
            found[int(index, 16), int(sub, 16) if sub else 0] = TYPES.get(kind, 0)
    return found


def test_profile_objects_have_the_lengths_of_a_public_dictionary(dictionary: dict[tuple[int, int], int]) -> None:
    known = {index: size for (index, sub), size in dictionary.items() if 0x6000 <= index < 0x6800 and sub in (0, 1)}
    known[0x607D] = dictionary[0x607D, 1]
    known[0x6099] = dictionary[0x6099, 1]
    compared = {index: size for index, size in profile.SIZES.items() if index in known}
    assert {index: known[index] for index in compared} == compared
    assert set(profile.SIZES) - set(compared) == ABSENT


def test_everything_that_a_life_writes_is_in_it(dictionary: dict[tuple[int, int], int]) -> None:
    writes = set()
    for can_id, data in frames_of_a_life("two-axis-homing"):
        if can_id in (0x601, 0x602) and data[0] >> 5 == 1:
            size = 4 - (data[0] >> 2 & 3)
            writes.add((int.from_bytes(data[1:3], "little"), data[3], size))
    assert len(writes) > 25
    for index, sub, size in sorted(writes):
        if index not in ABSENT:
            assert abs(dictionary[index, sub]) == size, f"0x{index:04X}:{sub:02X}"
