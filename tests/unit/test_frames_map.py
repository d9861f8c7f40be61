"""The roles of a DBC's signals: found, or refused with a sentence."""

from pathlib import Path
from typing import Any

import pytest

from station.adapters.dbc import read_layouts
from station.domain.can.sensor_layout import FrameMap, SensorLayout, resolve
from station.domain.can.signals import FrameLayout, SignalLayout
from station.domain.core.types import EXTENDED
from station.errors import ProductError

DBC = Path(__file__).resolve().parents[2] / "dbc" / "accelerometer.dbc"
BLOCK: dict[str, Any] = {
    "dbc": "accelerometer.dbc",
    "sample": {
        "message": "ACCELERATION",
        "x": "X",
        "y": "Y",
        "z": "Z",
        "counter": "COUNTER",
        "status": "STATUS",
        "crc": "CRC",
    },
    "temperature": {"message": "TEMPERATURE", "signal": "TEMPERATURE"},
    "node_of_dbc": 1,
    "counter_values": 15,
    "e2e": {"profile": "P01", "mode": "both", "data_id": 0x1A00, "data_id_plus_node": True},
}
BARE = {"dbc": "accelerometer.dbc", "sample": {"message": "ACCELERATION", "x": "X", "y": "Y", "z": "Z"}}


def _resolve(block: dict[str, Any]) -> SensorLayout:
    return resolve(FrameMap.model_validate(block), read_layouts(DBC))


def test_our_own_product_resolves_and_follows_the_node() -> None:
    layout = _resolve(BLOCK)
    assert [s.name for s in layout.axes] == ["X", "Y", "Z"]
    assert layout.ids(1) == (0x181, 0x281)
    assert layout.ids(5) == (0x185, 0x285)
    assert (layout.counter_values, layout.crc_byte) == (15, 0)


def test_only_the_axes_are_needed() -> None:
    layout = _resolve(BARE)
    assert (layout.counter, layout.counter_values, layout.temperature) == (None, 1, None)
    assert layout.ids(3) == (0x183,)


def test_without_a_profile_the_counter_takes_all_its_bits_hold() -> None:
    assert _resolve({**BARE, "sample": {**BARE["sample"], "counter": "COUNTER"}}).counter_values == 16  # type: ignore[dict-item]


def test_identifiers_that_do_not_fit_are_refused() -> None:
    signals = tuple(SignalLayout(n, 8 * i, 8) for i, n in enumerate("XYZ"))
    roles = FrameMap.model_validate({**BARE, "node_of_dbc": 1})
    short = resolve(roles, {"ACCELERATION": FrameLayout("ACCELERATION", 0x7FF, 3, signals)})
    assert short.ids(1) == (0x7FF,)
    with pytest.raises(ProductError, match="ACCELERATION of node 2 would have the identifier 0x800"):
        short.ids(2)
    long = resolve(roles, {"ACCELERATION": FrameLayout("ACCELERATION", 0x7FF | EXTENDED, 3, signals)})
    assert long.ids(2) == (0x800 | EXTENDED,)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            {"sample": {**BLOCK["sample"], "x": "AX"}},
            r"accelerometer\.dbc: message ACCELERATION has no signal AX",
        ),
        ({"sample": {**BLOCK["sample"], "message": "ACC"}}, r"has no message ACC; its messages are ACCELERATION, TEMP"),
        ({"temperature": {"message": "TEMPERATURE", "signal": "T"}}, "TEMPERATURE has no signal T; its signals are"),
        ({"temperature": {"message": "T", "signal": "T"}}, "no message T"),
        ({"sample": {**BLOCK["sample"], "counter": "X"}}, "counter X must be an unsigned integer"),
        ({"bad_status": {"hot": 0x10}}, "bad_status 'hot' has the bits 0x10, which the 4 bits of STATUS cannot show"),
        ({"e2e": None, "counter_values": 17}, "counter COUNTER has 4 bits and cannot take 17 values"),
        ({"sample": {**BLOCK["sample"], "crc": "STATUS"}}, "CRC STATUS must be one whole byte for profile P01"),
    ],
)
def test_what_the_dbc_lacks_is_named(change: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ProductError, match=sentence):
        _resolve({**BLOCK, **change})


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"sample": {**BARE["sample"]}}, "e2e needs a CRC and a counter"),  # type: ignore[dict-item]
        ({"e2e": None, "sample": {**BARE["sample"]}}, "counter_values needs sample.counter"),  # type: ignore[dict-item]
        ({"e2e": None, "counter_values": None, **BARE, "bad_status": {"hot": 1}}, "bad_status needs sample.status"),
        ({"counter_values": 16}, "profile P01 fixes counter_values at 15"),
        ({"node_of_dbc": 0}, "greater than or equal to 1"),
        ({"e2e": None, "sample": {"message": "A", "x": "X", "z": "Z"}}, "z is named but y is not"),
        ({"e2e": None, "sample": {"message": "A", "x": ["X", "X2"], "y": "Y", "z": "Z"}}, "have 2, 1, 1 signals"),
        ({"unknown": 1}, "Extra inputs"),
    ],
)
def test_a_map_that_contradicts_itself_is_refused(change: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        FrameMap.model_validate({**BLOCK, **change})
