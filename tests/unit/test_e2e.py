"""End-to-end protection: AUTOSAR's known answers, the C library autosar-e2e, cantools, and injected faults."""

import e2e as autosar
import numpy as np
import pytest
from cantools.autosar.end_to_end import compute_profile2_crc
from hypothesis import given
from hypothesis import strategies as st

from station.domain.can import e2e
from station.domain.can.sensor_layout import EndToEnd, FrameMap, SensorLayout, resolve
from station.domain.can.signals import FrameLayout, SignalLayout

IDS = tuple(range(100, 116))
MODES = {"both": 0, "alt": 1, "low": 2, "nibble": 3}


def _layout(protection: EndToEnd, length: int = 8) -> SensorLayout:
    """CRC in byte 0, counter in the low nibble of byte 1, as both profiles have it."""
    names = {"crc": ("C", 0, 8), "counter": ("N", 8, 4), "x": ("X", 12, 2), "y": ("Y", 14, 1), "z": ("Z", 15, 1)}
    signals = tuple(SignalLayout(name, start, bits) for name, start, bits in names.values())
    sample = {"message": "F", **{role: name for role, (name, _, _) in names.items()}}
    roles = FrameMap.model_validate({"dbc": "test.dbc", "sample": sample, "e2e": protection.model_dump()})
    return resolve(roles, {"F": FrameLayout("F", 0x181, length, signals)})


def _checksum(data: bytes, protection: EndToEnd, node: int = 1) -> int:
    array = np.frombuffer(data.ljust(8, b"\0"), np.uint8)[None]
    counter = np.array([data[1] & 0xF], np.uint64)
    return int(e2e.checksum(array, counter, _layout(protection, len(data)), node)[0])


def test_tables_match_the_published_check_values() -> None:
    """CRC-8/SAE-J1850 of "123456789" is 0x4B, CRC-8/AUTOSAR (0x2F) is 0xDF (SWS_CRCLibrary, check values)."""
    text = list(np.frombuffer(b"123456789", np.uint8)[:, None])
    assert e2e.crc8(text, 0x1D, start=0xFF)[0] ^ 0xFF == 0x4B
    assert e2e.crc8(text, 0x2F, start=0xFF)[0] ^ 0xFF == 0xDF


def test_profile_1_known_answers_of_the_protocol_specification() -> None:
    """AUTOSAR FO PRS E2EProtocol, example of profile 1: DataID 0x123, both, 8 zero bytes: CRC 0xCC, then 0x91."""
    protection = EndToEnd(profile="P01", data_id=0x123)
    assert _checksum(bytes(8), protection) == 0xCC
    assert _checksum(bytes([0, 1, 0, 0, 0, 0, 0, 0]), protection) == 0x91


@pytest.mark.parametrize("mode", MODES)
@given(data=st.binary(min_size=2, max_size=8), data_id=st.integers(0, 0xFFFF))
def test_profile_1_agrees_with_the_c_library(mode: str, data: bytes, data_id: int) -> None:
    expected = bytearray(data)
    autosar.p01.e2e_p01_protect(expected, data_id, data_id_mode=MODES[mode], increment_counter=False)
    protection = EndToEnd(profile="P01", mode=mode, data_id=data_id)  # type: ignore[arg-type]
    assert _checksum(bytes(expected), protection) == expected[0]


@given(data=st.binary(min_size=2, max_size=8), ids=st.binary(min_size=16, max_size=16))
def test_profile_2_agrees_with_the_c_library_and_with_cantools(data: bytes, ids: bytes) -> None:
    expected = bytearray(data)
    autosar.p02.e2e_p02_protect(expected, ids, increment_counter=False)
    theirs = compute_profile2_crc(data, ids[data[1] & 0xF])
    assert _checksum(data, EndToEnd(profile="P02", data_ids=tuple(ids))) == expected[0] == theirs


def test_the_data_id_follows_the_node_when_told_so() -> None:
    fixed = EndToEnd(profile="P01", data_id=0x1A00)
    moving = EndToEnd(profile="P01", data_id=0x1A00, data_id_plus_node=True)
    assert [fixed.data_id_of(n) for n in (1, 5)] == [0x1A00, 0x1A00]
    assert [moving.data_id_of(n) for n in (1, 5)] == [0x1A01, 0x1A05]
    data = bytes([0, 3, 1, 2, 3, 4, 5, 6])
    assert _checksum(data, moving, 5) == _checksum(data, EndToEnd(profile="P01", data_id=0x1A05))
    assert _checksum(data, moving, 5) != _checksum(data, moving, 6)


@given(data=st.binary(min_size=8, max_size=8), bit=st.integers(0, 63), data_id=st.integers(0, 0xFFFF))
def test_no_single_flipped_bit_gets_through(data: bytes, bit: int, data_id: int) -> None:
    protection = EndToEnd(profile="P01", data_id=data_id)
    right = bytes([_checksum(data, protection), *data[1:]])
    flipped = bytearray(right)
    flipped[bit // 8] ^= 1 << bit % 8
    assert _checksum(bytes(flipped), protection) != flipped[0]


def test_nibble_mode_checks_the_nibble_that_is_sent() -> None:
    layout = _layout(EndToEnd(profile="P01", mode="nibble", data_id=0x0A55))
    data = np.zeros((16, 8), np.uint8)
    data[:, 1] = np.arange(16) << 4
    assert np.flatnonzero(e2e.nibble_ok(data, layout, 1)).tolist() == [0xA]
    both = _layout(EndToEnd(profile="P01", data_id=0x0A55))
    assert e2e.nibble_ok(data, both, 1).all()


@pytest.mark.parametrize(
    ("block", "complaint"),
    [
        ({"profile": "P01"}, "P01 needs data_id"),
        ({"profile": "P01", "data_id": 1, "data_ids": list(IDS)}, "P01 needs data_id"),
        ({"profile": "P02", "data_ids": [1, 2]}, "list of 16 bytes"),
        ({"profile": "P02", "data_ids": list(IDS), "data_id": 7}, "list of 16 bytes"),
        ({"profile": "P03", "data_id": 7}, "profile"),
        ({"profile": "P01", "data_id": 0x10000}, "data_id"),
    ],
)
def test_incomplete_protection_is_refused(block: dict[str, object], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        EndToEnd.model_validate(block)
