"""A calibration as bytes and back, over all formats, orders, signs and conventions; what cannot be is refused."""

import math
import zlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from station.domain.core.types import Calibration, Floats
from station.domain.product import number_format, writeback
from station.domain.product.device_map import DeviceMap
from station.errors import ProductError, UnitFault

FORMATS: dict[str, dict[str, Any]] = {
    "REAL32": {"type": "REAL32"},
    "REAL64": {"type": "REAL64"},
    "INT16": {"type": "INT16", "scale": 1 / 8192},
    "INT32": {"type": "INT32", "scale": 1e-7},
    "Q2.14": {"type": "Q2.14"},
    "Q3.29": {"type": "Q3.29"},
    "ppm32": {"type": "ppm32"},
    "deviation": {"type": "INT32", "scale": 1e-8, "from_nominal": True},
}


def device_map(**parts: Any) -> DeviceMap:
    matrix = {"index": 0x2101, **parts.pop("matrix", {})}
    offset = {"index": 0x2102, **parts.pop("offset", {})}
    return DeviceMap.model_validate({"matrix": matrix, "offset": offset, **parts})


def calibration(offset: Any, matrix: Any) -> Calibration:
    return Calibration(
        method="six-point",
        unit="g",
        offset=np.asarray(offset, float),
        matrix=np.asarray(matrix, float),
        covariance=np.zeros((12, 12)),
        positions=(),
        residual=np.zeros((0, 3)),
        tilt_deg=np.zeros(0),
        tilt_std_deg=np.zeros(0),
        disturbed=np.zeros(0, bool),
        residual_rms=0.0,
    )


def raws(writes: tuple[writeback.ObjectWrite, ...]) -> dict[tuple[int, int], bytes]:
    return {w.address: w.raw for w in writes}


GOOD = calibration([0.012, -0.003, 0.021], [[1.01, 0.002, 0.0], [0.001, 0.99, -0.001], [0.0, 0.003, 1.0]])
SMALL = st.floats(-0.05, 0.05)


@given(
    b=st.lists(SMALL, min_size=3, max_size=3),
    e=st.lists(SMALL, min_size=9, max_size=9),
    stores=st.sampled_from(["forward", "inverse", "inverse-add"]),
    order=st.sampled_from(["row", "column"]),
    matrix=st.sampled_from(list(FORMATS)),
    offset=st.sampled_from(list(FORMATS)),
    signs=st.tuples(st.sampled_from([1, -1]), st.sampled_from([1, -1])),
)
def test_what_is_encoded_is_decoded_within_the_rounding(
    b: list[float], e: list[float], stores: str, order: str, matrix: str, offset: str, signs: tuple[int, int]
) -> None:
    A = np.eye(3) + np.reshape(e, (3, 3))
    given_map = device_map(
        stores=stores,
        matrix={**FORMATS[matrix], "order": order, "sign": signs[0]},
        offset={**FORMATS[offset], "sign": signs[1]},
    )
    got_b, got_A = writeback.decode(given_map, raws(writeback.encode(given_map, calibration(b, A))))
    # Each kept number is at most half a step off, √3 standard deviations; twelve of them add at most linearly.
    bound = math.sqrt(3) * 12 * float(writeback.rounding_std(given_map, np.array(b), A).max()) * 1.01 + 1e-12
    np.testing.assert_allclose(got_A, A, atol=bound, rtol=0)
    np.testing.assert_allclose(got_b, b, atol=bound, rtol=0)


@pytest.mark.parametrize("stores", ["forward", "inverse", "inverse-add"])
def test_the_device_corrects_by_its_own_formula_as_the_station_does(stores: str) -> None:
    given_map = device_map(stores=stores, matrix={"type": "REAL64"}, offset={"type": "REAL64"})
    stored = {w.name: w.value for w in writeback.encode(given_map, GOOD)}
    c = np.array([stored[f"offset.{a}"] for a in "xyz"])
    M = np.array([[stored[f"matrix.{r}{s}"] for s in "xyz"] for r in "xyz"])
    measured = np.array([0.3, -0.8, 0.5])
    formulas: dict[str, Callable[[], Floats]] = {
        "forward": lambda: np.linalg.solve(M, measured - c),
        "inverse": lambda: M @ (measured - c),
        "inverse-add": lambda: M @ measured + c,
    }
    np.testing.assert_allclose(formulas[stores](), GOOD.correct(measured), atol=1e-14)


def test_order_sign_and_scale_are_where_they_are_said_to_be() -> None:
    given_map = device_map(
        matrix={
            "sub": 5,
            "order": "column",
            "type": "Q2.14",
            "each": {"yx": {"sign": -1}, "zz": {"index": 0x2200, "sub": 0}},
        },
        offset={"sub": 1, "type": "INT16", "scale": 0.001, "sign": -1},
    )
    writes = {w.name: w for w in writeback.encode(given_map, GOOD)}
    assert [w.address for w in writes.values()][:3] == [(0x2101, 5), (0x2101, 6), (0x2101, 7)]
    assert list(writes)[:3] == ["matrix.xx", "matrix.yx", "matrix.zx"]
    assert writes["matrix.zz"].address == (0x2200, 0)
    assert writes["matrix.xx"].raw == round(1.01 * 2**14).to_bytes(2, "little", signed=True)
    assert writes["matrix.yx"].raw == round(-0.001 * 2**14).to_bytes(2, "little", signed=True)
    assert writes["offset.x"].raw == (-12).to_bytes(2, "little", signed=True)


def test_gains_only() -> None:
    given_map = device_map(matrix={"order": "diagonal", "type": "ppm32"})
    gains = calibration([0, 0, 0], np.diag([1.01, 0.99, 1.0]))
    writes = writeback.encode(given_map, gains)
    assert [w.raw for w in writes[:3]] == [n.to_bytes(4, "little", signed=True) for n in (10_000, -10_000, 0)]
    np.testing.assert_allclose(writeback.decode(given_map, raws(writes))[1], gains.matrix, atol=1e-9)
    with pytest.raises(ProductError, match="offset-gain"):
        writeback.encode(given_map, GOOD)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_what_is_not_finite_is_never_written(value: float) -> None:
    with pytest.raises(UnitFault, match="not finite, so nothing was written"):
        writeback.encode(device_map(), replace(GOOD, offset=np.array([0, value, 0])))


def test_beyond_the_limits_or_the_type_is_refused_by_name_and_address() -> None:
    with pytest.raises(
        UnitFault, match=r"offset\.z = 0\.021 is outside -0\.02 to 0\.02, the range of 0x2102:03; nothing"
    ):
        writeback.encode(device_map(offset={"limits": [-0.02, 0.02]}), GOOD)
    with pytest.raises(UnitFault, match=r"matrix\.xx = 1\.01 cannot be stored at 0x2101:01: Q1\.15 holds"):
        writeback.encode(device_map(matrix={"type": "Q1.15"}), GOOD)


def test_a_matrix_without_inverse_is_refused() -> None:
    flat = calibration([0, 0, 0], np.ones((3, 3)))
    with pytest.raises(UnitFault, match="has no inverse"):
        writeback.encode(device_map(stores="inverse"), flat)
    with pytest.raises(UnitFault, match="has no inverse"):
        zeros = {n.address: bytes(4) for _, n in device_map().coefficients()}
        writeback.decode(device_map(stores="inverse"), zeros)


def test_bytes_that_say_nothing_are_refused() -> None:
    good = raws(writeback.encode(device_map(), GOOD))
    with pytest.raises(UnitFault, match=r"offset\.x at 0x2102:01 is not a finite number"):
        writeback.decode(device_map(), {**good, (0x2102, 1): b"\x00\x00\xc0\x7f"})
    with pytest.raises(UnitFault, match=r"REAL32 has 4 bytes, not 2; check the device map"):
        writeback.decode(device_map(), {**good, (0x2102, 1): b"\x00\x00"})
    with pytest.raises(UnitFault, match="was not read"):
        writeback.decode(device_map(), {at: raw for at, raw in good.items() if at != (0x2101, 9)})


@pytest.mark.parametrize("stores", ["forward", "inverse", "inverse-add"])
@pytest.mark.parametrize("shape", ["INT16", "Q2.14", "REAL32"])
def test_rounding_is_as_uncertain_as_it_is_said_to_be(stores: str, shape: str, rng: np.random.Generator) -> None:
    given_map = device_map(stores=stores, matrix=FORMATS[shape], offset=FORMATS[shape])
    n, errors = 600, []
    for _ in range(n):
        # Near the nominal values, but spread over many steps, so that each rounding error is uniform.
        b, A = rng.uniform(0.3, 0.4, 3), np.eye(3) + rng.uniform(0.1, 0.11, (3, 3))
        got_b, got_A = writeback.decode(given_map, raws(writeback.encode(given_map, calibration(b, A))))
        errors.append(np.concatenate([got_b - b, (got_A - A).ravel()]) / writeback.rounding_std(given_map, b, A))
    # Variance of a sum of uniforms about 1: its own standard deviation is below √(2/n); five of those, and the
    # change of a REAL32's step within the spread.
    ratio = np.var(errors, axis=0)
    assert np.all(np.abs(ratio - 1) < 5 * math.sqrt(2 / n) + 0.05), ratio


def test_half_written_is_recognised() -> None:
    old = {(1, 1): b"a", (1, 2): b"b", (1, 3): b"c"}
    new = {(1, 1): b"A", (1, 2): b"B", (1, 3): b"c"}
    assert writeback.classify(old, new, new) == "new"
    assert writeback.classify(old, new, old) == "old"
    assert writeback.classify(old, new, {**old, (1, 1): b"A"}) == "mixed"
    assert writeback.classify(old, new, {**old, (1, 1): b"?"}) == "other"
    assert writeback.classify(old, new, {(1, 1): b"A"}) == "other"
    assert writeback.classify(old, old, old) == "new"  # nothing to change: what was to be written is there


def test_the_sequence_follows_the_map() -> None:
    given_map = device_map(
        unlock={"index": 0x2104, "key": 0x1234},
        valid={"index": 0x2107},
        temperature={"index": 0x2103, "type": "REAL32"},
        record={"index": 0x2100, "length": 8},
        configuration={"index": 0x1020},
        order=["unlock", "invalidate", "offset", "matrix", "temperature", "record", "configuration", "validate"],
    )
    # 2026-11-21 00:00:01.500 UTC is 15,665 days and 1,500 ms after 1984-01-01.
    when = (5_113 + 15_665) * 86_400 * 10**9 + 1_500_000_000
    writes = writeback.sequence(given_map, GOOD, record="R-1", temperature_degC=23.5, epoch_ns=when)
    names = [w.name for w in writes]
    assert names[:3] == ["unlock", "invalidate", "offset.x"]
    assert names[-5:] == ["temperature", "record", "configuration date", "configuration time", "validate"]
    by_name = {w.name: w for w in writes}
    assert by_name["unlock"].raw == (0x1234).to_bytes(4, "little")
    assert not by_name["unlock"].read_back
    assert (by_name["invalidate"].raw, by_name["validate"].raw) == (b"\0", b"\1")
    assert by_name["record"].raw == b"R-1"
    assert by_name["configuration date"].raw == (15_665).to_bytes(4, "little")
    assert by_name["configuration time"].raw == (1_500).to_bytes(4, "little")
    assert writeback.sequence(given_map, GOOD)[-1].name == "validate"
    assert len(writeback.sequence(device_map(), GOOD)) == 12
    with pytest.raises(ProductError, match="takes 8"):
        writeback.sequence(given_map, GOOD, record="123456789")


def test_the_checksum_is_over_the_bytes_in_the_order_said() -> None:
    given_map = device_map(checksum={"index": 0x2105, "over": ["offset", "matrix"]})
    stored = raws(writeback.encode(given_map, GOOD))
    data = b"".join(stored[0x2102, i] for i in (1, 2, 3)) + b"".join(stored[0x2101, i] for i in range(1, 10))
    assert writeback.expected_checksum(given_map, stored) == zlib.crc32(data).to_bytes(4, "little")
    assert writeback.expected_checksum(device_map(), stored) is None


def test_commands_carry_their_signatures_and_time_outs() -> None:
    given_map = device_map(
        save={"index": 0x1010, "sub": 3, "timeout_s": 7}, output={"index": 0x2106, "raw": 1, "compensated": 0}
    )
    save = writeback.save(given_map)
    assert save is not None
    assert (save.raw, save.address) == ((0x65766173).to_bytes(4, "little"), (0x1010, 3))
    assert given_map.timeouts() == {(0x1010, 3): 7.0}
    assert writeback.save(device_map(save=None)) is None
    raw, compensated = writeback.output(given_map, raw=True), writeback.output(given_map, raw=False)
    assert raw is not None and raw.raw == b"\1"
    assert compensated is not None and compensated.raw == b"\0"
    assert writeback.output(device_map(), raw=True) is None


@pytest.mark.parametrize(
    ("parts", "printed"),
    [
        ({"matrix": {"type": "Q3.3"}}, "no number format"),
        ({"matrix": {"each": {"xw": {}}}}, "each names 'xw'"),
        ({"matrix": {"order": "diagonal", "each": {"xy": {}}}}, "each names 'xy'"),
        ({"offset": {"index": 0x2101, "sub": 9}}, "share 0x2101:09"),
        ({"order": ["matrix"]}, "leaves out 'offset'"),
        ({"order": ["matrix", "offset", "matrix"]}, "twice"),
        ({"serial": {"printed": "SN"}}, "exactly one group"),
        ({"serial": {"printed": "(["}}, "not a regular expression"),
        ({"offset": {"scale": 0}}, "greater than 0"),
        ({"offset": {"sign": 2}}, "sign"),
        ({"save": {"index": 0x12345}}, "less than or equal to 65535"),
    ],
)
def test_a_map_that_cannot_be_is_refused(parts: dict[str, Any], printed: str) -> None:
    with pytest.raises(ValidationError, match=printed):
        device_map(**parts)


def test_every_format_of_a_map_is_one_that_numbers_have() -> None:
    for _, number in device_map(matrix=FORMATS["ppm32"]).coefficients():
        assert number_format.parse(number.type).size == 4
