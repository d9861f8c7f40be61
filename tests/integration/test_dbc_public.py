"""DBC and EDS files as people write them: what nobody uses is no reason to refuse the rest."""

from pathlib import Path

import pytest
from cantools import database
from cantools.database.errors import Error

from station.adapters.dbc import read_layouts
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
        return len(database.load_file(str(path), strict=False).messages)
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
