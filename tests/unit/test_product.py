"""Product files: identity in words, serials as printed and as kept, and the map against the EDS."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from station.adapters.bus._wire import KINDS as WIRE
from station.adapters.canopen import eds
from station.adapters.simulated_device.device_fault import KINDS
from station.config.products import load_product
from station.domain.product import map_check
from station.domain.product.device_map import DeviceMap, SerialObject
from station.domain.product.object_dictionary import ObjectDictionary
from station.domain.product.product import Product, decode_serial, stored_serial
from station.domain.product.sdo_codes import ABORT, meaning
from station.errors import ProductError, UsageError
from station.messages import render
from station.wiring.jobs import check_product, load_job

DBC = Path(__file__).parents[2] / "dbc"
SHIPPED = sorted(path.stem for path in DBC.glob("*.yaml"))


@pytest.fixture
def product() -> Product:
    return load_product("accelerometer")


def identity(**other: Any) -> dict[str, Any]:
    right = {"device_type": 0x20194, "vendor": 0xCA1B0, "product": 0xACC, "revision": 0x10000, "name": "accelerometer"}
    return {**right, **other}


def test_the_right_device_is_recognised(product: Product) -> None:
    assert product.mismatches(**identity()) == ()
    assert product.mismatches(**identity(revision=0x20001)) == ()


@pytest.mark.parametrize(
    ("other", "sentences"),
    [
        ({"vendor": 1}, "vendor is 0x1, not 0xCA1B0"),
        ({"product": 2}, "product code is 0x2, not 0xACC"),
        ({"device_type": 0}, "device type is 0x0, not 0x20194"),
        ({"revision": 0xFFFF}, "revision is 0xFFFF, older than 0x10000"),
        ({"name": "x"}, "name is 'x', not 'accelerometer'"),
    ],
)
def test_each_difference_is_said(product: Product, other: dict[str, Any], sentences: str) -> None:
    assert [render(m) for m in product.mismatches(**identity(**other))] == [sentences]


def test_serial_as_printed_and_as_kept() -> None:
    assert stored_serial(SerialObject(), "SN0042") == 42
    assert decode_serial(SerialObject(), (42).to_bytes(4, "little")) == 42
    text = SerialObject(kind="text", printed="^(.*)$")
    assert stored_serial(text, "A-7") == "A-7"
    assert decode_serial(text, b"A-7\0\0") == "A-7"
    with pytest.raises(UsageError, match="does not match"):
        stored_serial(SerialObject(), "SN-none")


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_map_agrees_with_its_eds(name: str) -> None:
    product = load_product(name)
    assert product.eds is not None
    assert map_check.mismatches(product.map, eds.load(DBC / product.eds, 1)) == ()


def test_a_map_that_contradicts_its_eds_is_told_so(product: Product) -> None:
    good = eds.load(DBC / "accelerometer.eds", 1)
    entries = dict(good.entries)
    del entries[0x2107, 0]
    entries[0x2101, 1] = replace(entries[0x2101, 1], high=1.2)
    entries[0x2101, 2] = replace(entries[0x2101, 2], type=0x03)
    entries[0x2102, 1] = replace(entries[0x2102, 1], access="ro")
    assert [render(m) for m in map_check.mismatches(product.map, ObjectDictionary(1, entries))] == [
        "matrix.xy at 0x2101:02 is REAL32 in the map but INT16 in the EDS",
        "offset.x at 0x2102:01 is ro in the EDS, so it cannot be written",
        "valid at 0x2107:00 is not in the EDS",
        "matrix.xx at 0x2101:01 takes -1.5 to 1.5 by the map, but the EDS allows -1.5 to 1.2",
    ]


def test_real32_limits_of_an_eds_are_kept() -> None:
    entry = eds.load(DBC / "accelerometer.eds", 0x11)[0x2102, 3]
    assert (entry.low, entry.high, entry.type_name, entry.access) == (-0.5, 0.5, "REAL32", "rw")


def test_node_ids_are_worked_out_and_the_eds_is_its_own_0x1021() -> None:
    found = eds.load(DBC / "accelerometer.eds", 0x11)
    assert found[0x1800, 1].default == 0x191
    assert found[0x1014, 0].default == 0x91
    assert found[0x1021, 0].default == (DBC / "accelerometer.eds").read_bytes()


BAD = "[DeviceInfo]\nGranularity=8\n[2000]\nParameterName=a\nAccessType=rw\n"


@pytest.mark.parametrize(
    ("text", "sentences"),
    [
        ("", "has no [DeviceInfo]"),
        ("[DeviceInfo]\nGranularity=8\n", "describes no objects"),
        ("no section", "is not a usable EDS"),
        (BAD + "DataType=0x0007\nDefaultValue=007\n", "the default of 0x2000:00 is not a number"),
        (BAD + "DataType=0x0008\nLowLimit=nan\n", "the limit 'nan' of 0x2000:00"),
        (BAD + "DataType=0x0008\nHighLimit=high\n", "the limit 'high' of 0x2000:00"),
        (BAD + "DataType=0x000C\n", "0x2000:00 has the data type 0xc"),
        (BAD + "DataType=seven\n", "is not a usable EDS"),
        ("[DeviceInfo]\n[2000sub1]\nParameterName=a\nDataType=7\nAccessType=rw\n", "is not a usable EDS"),
    ],
)
def test_a_bad_eds_gets_one_sentence_with_its_name(tmp_path: Path, text: str, sentences: str) -> None:
    path = tmp_path / "bad.eds"
    path.write_text(text)
    with pytest.raises(ProductError) as caught:
        eds.load(path, 1)
    assert sentences in caught.value.sentence
    assert "bad.eds" in caught.value.sentence


def test_a_missing_eds_gets_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ProductError, match=r"none\.eds cannot be read"):
        eds.load(tmp_path / "none.eds", 1)


@pytest.mark.parametrize("code", ABORT)
def test_every_abort_code_has_a_meaning(code: int) -> None:
    assert len(render(meaning(code)).split()) >= 2
    assert meaning(code) != meaning(0x1234)


def test_the_codes_are_those_of_the_common_library() -> None:
    from canopen import SdoAbortedError

    assert set(ABORT) == set(SdoAbortedError.CODES)


def test_an_unknown_code_is_specific_to_the_manufacturer() -> None:
    assert render(meaning(0x12345678)) == "manufacturer-specific reason"


def test_the_guides_name_every_fault_and_their_maps_are_right() -> None:
    docs = DBC.parent / "docs"
    faults = (docs / "simulated-device.md").read_text()
    assert [kind for kind, shown in {**KINDS, **WIRE}.items() if f"| `{kind}` | {shown} |" not in faults] == []
    blocks = re.findall(r"```yaml\n(.*?)```", (docs / "device-map.md").read_text(), re.DOTALL)
    assert len(blocks) == 9
    for block in blocks:
        DeviceMap.model_validate(yaml.safe_load(block)["map"])


def test_a_job_whose_map_contradicts_its_eds_is_refused_before_anything_moves(tmp_path: Path) -> None:
    for name in ("accelerometer.dbc", "accelerometer.eds"):
        (tmp_path / name).write_bytes((DBC / name).read_bytes())
    text = (DBC / "accelerometer.yaml").read_text()
    (tmp_path / "accelerometer.yaml").write_text(text.replace("limits: [-1.5, 1.5]", "limits: [-2, 2]"))
    recipe = tmp_path / "six-point.yaml"
    recipe.write_text((DBC.parent / "recipes" / "six-point.yaml").read_text())
    with pytest.raises(ProductError) as caught:
        load_job(recipe)
    assert "accelerometer.yaml: the device map contradicts accelerometer.eds: matrix.xx at" in caught.value.sentence


@pytest.mark.parametrize("key", ["eds", "dbc"])
def test_a_file_that_a_product_names_and_nobody_can_read_is_told_with_its_key(tmp_path: Path, key: str) -> None:
    for name in ("accelerometer.dbc", "accelerometer.eds"):
        (tmp_path / name).write_bytes((DBC / name).read_bytes())
    text = (DBC / "accelerometer.yaml").read_text()
    where = tmp_path / "accelerometer.yaml"
    where.write_text(text.replace(f"{key}: accelerometer.{key}", f"{key}: /proc/self/mem"))
    with pytest.raises(ProductError) as refused:
        check_product(str(where))
    told = refused.value.sentence
    assert str(where) in told
    assert f"{key}`" in told
    assert "/proc/self/mem cannot be read" in told
