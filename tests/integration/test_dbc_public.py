"""DBC and EDS files as people write them: what nobody uses is no reason to refuse the rest."""

from pathlib import Path
from typing import Any

import pytest
from cantools import database
from cantools.database.errors import Error

from station.adapters.canopen.eds import load
from station.adapters.dbc import read_layouts
from station.domain.core.types import EXTENDED
from station.errors import ProductError
from tests.unit.test_frames_lint import DBC

#: Both mistakes stand in messages that the product does not use.
STRANGER = """\
BO_ 700 STRANGER: 8 A
 SG_ LIMIT : 0|7@1+ (1,0) [0|255] "°C" A
 SG_ OVER : 4|8@1+ (1,0) [0|0] "" A
"""


def messages_by_cantools(path: Path) -> int:
    """How many messages cantools reads, leniently; 0 where it refuses the file."""
    try:
        read: Any = database.load_file(str(path), strict=False)
        return len(read.messages)
    except (Error, UnicodeDecodeError):
        return 0


def test_public_files_are_read_wherever_nothing_is_used(reference_data: Path) -> None:
    files = sorted((reference_data / "dbc_public").rglob("*.dbc"))
    assert len(files) >= 90
    refused = []
    for path in files:
        try:
            layouts = read_layouts(path, {})
        except ProductError as error:
            refused.append(f"{path.name}: {error.sentence}")
            continue
        assert len(layouts) >= messages_by_cantools(path) * 0.95, path.name
    assert len(refused) <= 0.02 * len(files), refused


@pytest.mark.parametrize("wrong", ['BO_ 64100 ELSE: 8 A\n SG_ Q : 0|8@1+ (1,0) [0|255] "" A\n', STRANGER])
def test_what_is_not_used_is_not_checked(tmp_path: Path, wrong: str) -> None:
    path = tmp_path / "p.dbc"
    path.write_text(DBC.read_text(encoding="utf-8").replace("BO_ 641 ", f"{wrong}\nBO_ 641 ", 1), encoding="utf-8")
    used = {"ACCELERATION": ("X", "Y", "Z"), "TEMPERATURE": ("TEMPERATURE",)}
    assert {"ACCELERATION", "TEMPERATURE"} <= set(read_layouts(path, used))
    with pytest.raises(ProductError):
        read_layouts(path)


def test_an_attribute_of_an_unknown_kind_is_left_out_everywhere(tmp_path: Path) -> None:
    """However often it is set: a tool that exports its own flags sets them for every message."""
    own = (
        'BA_DEF_ BO_ "Sendable" BOOL False True;\nBA_DEF_DEF_ "Sendable" True;\n'
        + 'BA_ "Sendable" BO_ 641 True;\n' * 100
    )
    path = tmp_path / "p.dbc"
    path.write_text("/* made\n * by hand */\n" + DBC.read_text(encoding="utf-8") + own, encoding="utf-8")
    assert {"ACCELERATION", "TEMPERATURE"} <= set(read_layouts(path, {"ACCELERATION": ("X",)}))


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("SG_ X : 16|16", "SG_ X : 17|16", "overlapping"),
        ("SG_ X : 16|16", "SG_ X : 16|", "this is not DBC syntax"),
        ("6.25E-005", "0", "scale"),
    ],
)
def test_what_is_used_is_checked_as_before(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    path = tmp_path / "p.dbc"
    path.write_text(DBC.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ProductError, match=sentence):
        read_layouts(path, {"ACCELERATION": ("X", "Y", "Z")})


def test_public_eds_files_are_read(reference_data: Path) -> None:
    files = sorted((reference_data / "eds_public").rglob("*.eds"))
    assert len(files) >= 4
    for path in files:
        assert (0x1018, 0) in load(path, 5, frozenset()), path.name


MESSY = """\
a stray line
[FileInfo]
FileName=x.eds
[Comments]
Lines=99
Line1=too few
[DeviceInfo]
VendorName=
VendorNumber=
NrOfRXPDO=
[1000]
ParameterName=Device type
ObjectType=0x7
DataType=0x0007
AccessType=ro
DefaultValue=0x20192
PDOMapping=0
[2001]
ParameterName=Text
DataType=0x000B
AccessType=ro
[2002]
ParameterName=Broken
DataType=zero
AccessType=ro
[2003]
ParameterName=Compact
ObjectType=0x8
DataType=0x0005
AccessType=rw
CompactSubObj=3
DefaultValue=7
[1000]
ParameterName=Device type again
ObjectType=0x7
DataType=0x0007
AccessType=ro
"""


def test_what_an_eds_says_of_other_objects_is_no_reason_to_refuse_it(tmp_path: Path) -> None:
    path = tmp_path / "messy.eds"
    path.write_text(MESSY, encoding="latin-1")
    found = load(path, 5, frozenset())
    assert (0x1000, 0) in found
    assert (0x2003, 1) in found
    assert (0x2002, 0) not in found
    with pytest.raises(ProductError, match="0x2001:00 has the data type"):
        load(path, 5, frozenset({(0x2001, 0)}))


def test_a_car_whose_identifiers_all_lack_the_flag_of_29_bits_is_read(tmp_path: Path) -> None:
    """More of them than there are repairs."""
    message = 'BO_ {} M{}: 8 A\n SG_ V : 0|8@1+ (1,0) [0|255] "" A\n'
    path = tmp_path / "car.dbc"
    path.write_text('VERSION ""\nBU_: A\n' + "".join(message.format(0x12DD5400 + i, i) for i in range(100)))
    found = read_layouts(path, {})
    assert [layout.can_id for layout in found.values()] == [EXTENDED | 0x12DD5400 + i for i in range(100)]
    with pytest.raises(ProductError, match="more than 11 bits in message M7"):
        read_layouts(path, {"M7": ("V",)})
