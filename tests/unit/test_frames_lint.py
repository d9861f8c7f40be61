"""A DBC that cannot be right is refused with file, line, signal and remedy."""

import logging
from pathlib import Path
from typing import Any

import canmatrix.formats
import cantools
import pytest

from station.adapters.dbc import read_layouts
from station.domain.can.dbc_rules import lint
from station.domain.can.signals import FrameLayout, SignalLayout
from station.domain.core.types import EXTENDED
from station.errors import ProductError
from station.messages import render

DBC = Path(__file__).resolve().parents[2] / "dbc" / "accelerometer.dbc"


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("BO_ 641 TEMP", "BO_ 385 TEMP", "line 17, TEMPERATURE: identifier 0x181 is also that of ACCELERATION"),
        ("BO_ 641 TEMPERATURE", "BO_ 641 ACCELERATION", "line 17, ACCELERATION: two messages have this name"),
        (
            '(6.25E-005,0) [-2.048|2.0479375] "g" STATION\n SG_ Y',
            '(0,0) [0|0] "g" STATION\n SG_ Y',
            "line 13, ACCELERATION.X: scale is 0",
        ),
        ("[0|14]", "[14|3]", "line 11, ACCELERATION.COUNTER: minimum 14 is above maximum 3"),
        ("[0|14]", "[-1|14]", "line 11, ACCELERATION.COUNTER: minimum -1 is negative but the signal is unsigned"),
        ("[0|14]", "[0|20]", "maximum 20 cannot be reached: 4 bits hold 0 to 15"),
        (
            "[-327.68|327.67]",
            "[-400|327.67]",
            "line 18, TEMPERATURE.TEMPERATURE: minimum -400 cannot be reached",
        ),
        (
            "[-327.68|327.67]",
            "[-400|400]",
            "line 18, TEMPERATURE.TEMPERATURE: its limits -400 to 400 cannot be reached: 16 bits hold -327.68",
        ),
        ('"degC"', '"℃"', "line 18, TEMPERATURE.TEMPERATURE: unit '℃' is not plain ASCII"),
        ("TEMPERATURE: 2", "TEMPERATURE: 1", "line 17: The signal TEMPERATURE does not fit in message"),
        ("BO_ 641 T", "BO_ 64100 T", "line 17: Standard frame id 0xfa64 is more than 11 bits"),
        ("SG_ X : 16|16", "SG_ X : 17|16", "line 9: The signals Y and X are overlapping"),
        ("SG_ X : 16|16", "SG_ X : 16|", "line 13: this is not DBC syntax"),
        ("SG_ X : 16|16", "SG_ X : 16|1e400", "line 13: '1e400' is no number that this statement takes"),
    ],
)
def test_each_mistake_is_named_with_its_line(old: str, new: str, sentence: str, tmp_path: Path) -> None:
    text = DBC.read_text()
    assert old in text
    path = tmp_path / "bad.dbc"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ProductError) as refused:
        read_layouts(path)
    assert refused.value.sentence.startswith(str(path))
    assert sentence in refused.value.sentence


def test_all_mistakes_come_at_once(tmp_path: Path) -> None:
    path = tmp_path / "bad.dbc"
    path.write_text(DBC.read_text().replace("6.25E-005", "0").replace("[0|14]", "[14|3]"))
    with pytest.raises(ProductError) as refused:
        read_layouts(path)
    assert [refused.value.sentence.count(s) for s in ("line 11", "line 13", "line 14", "line 15")] == [1, 1, 1, 1]


def test_our_own_dbc_is_clean_and_quiet(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        layouts = read_layouts(DBC)
    assert list(layouts) == ["ACCELERATION", "TEMPERATURE"]
    assert not caplog.records


def test_two_parsers_read_our_dbc_alike() -> None:
    theirs = canmatrix.formats.loadp_flat(str(DBC))
    for layout in read_layouts(DBC).values():
        frame = theirs.frame_by_name(layout.name)
        assert (frame.arbitration_id.id, frame.size) == (layout.can_id, layout.length)
        for signal in layout.signals:
            other = frame.signal_by_name(signal.name)
            assert (other.start_bit, other.size, other.is_signed) == (signal.start, signal.length, signal.signed)
            assert (float(other.factor), float(other.offset), other.unit) == (signal.scale, signal.offset, signal.unit)
            assert (float(other.min), float(other.max)) == (signal.minimum, signal.maximum)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(ProductError, match=r"absent\.dbc cannot be read \(no such file"):
        read_layouts(tmp_path / "absent.dbc")
    with pytest.raises(ProductError, match="cannot be read"):
        read_layouts(tmp_path)
    (tmp_path / "empty.dbc").touch()
    with pytest.raises(ProductError, match=r"empty\.dbc holds no message"):
        read_layouts(tmp_path / "empty.dbc")


def test_a_file_of_more_nodes_than_any_car_has_is_refused_before_it_is_parsed(tmp_path: Path) -> None:
    path = tmp_path / "nodes.dbc"
    nodes = " ".join(f"N{number}" for number in range(30_000))
    for between in ("", "\n "):
        path.write_text(DBC.read_text(encoding="utf-8").replace("BU_:", f"BU_:{between} {nodes}", 1), encoding="utf-8")
        with pytest.raises(ProductError, match="nodes, messages and signals; at most 25000 are read"):
            read_layouts(path)


def test_western_text_is_read_as_such(tmp_path: Path) -> None:
    path = tmp_path / "western.dbc"
    path.write_bytes(DBC.read_text().replace("one reading", "Größe").encode("cp1252"))
    assert list(read_layouts(path)) == ["ACCELERATION", "TEMPERATURE"]


def _texts(*signals: SignalLayout, length: int = 8) -> list[str]:
    return [render(f.mistake) for f in lint([FrameLayout("F", 1, length, signals)])]


def test_rules_that_no_parsed_file_reaches() -> None:
    assert "is listed twice" in _texts(SignalLayout("A", 0, 8), SignalLayout("A", 8, 8))[0]
    assert "0 bytes long" in _texts(SignalLayout("A", 0, 8), length=0)[0]
    assert "is not a number" in _texts(SignalLayout("A", 0, 8, scale=float("nan")))[0]
    assert "a float has 16, 32 or 64 bits, not 24" in _texts(SignalLayout("A", 0, 24, is_float=True))[0]
    assert "length 65" in _texts(SignalLayout("A", 0, 65))[0]
    chosen = SignalLayout("A", 8, 8, selector="M", selected_by=(3, 300))
    assert "multiplexer M does not exist" in _texts(chosen)[0]
    assert "cannot take the value 300" in _texts(SignalLayout("M", 0, 8), chosen)[0]
    assert "is a float" in _texts(SignalLayout("M", 0, 32, is_float=True), chosen)[0]


def test_limits_are_judged_through_scale_and_offset() -> None:
    assert not _texts(SignalLayout("A", 0, 8, scale=-0.5, offset=100, minimum=-27.5, maximum=100))
    assert not _texts(SignalLayout("A", 0, 8, signed=True, scale=0.1, minimum=-12.8, maximum=12.7))
    assert _texts(SignalLayout("A", 0, 8, scale=-0.5, offset=100, minimum=-29, maximum=100))
    assert not _texts(SignalLayout("A", 0, 32, is_float=True, minimum=-1e30, maximum=1e30))


def test_limits_rounded_by_their_author_are_no_mistake() -> None:
    assert not _texts(SignalLayout("A", 0, 14, scale=1e-4, offset=-0.8192, minimum=-0.8192, maximum=0.8192))
    assert not _texts(SignalLayout("A", 0, 16, scale=0.00012742, offset=-4.1768, minimum=-4.1768, maximum=4.1765))
    assert _texts(SignalLayout("A", 0, 16, signed=True, scale=0.1, minimum=-3276.8, maximum=3290))


def test_equal_numbers_in_both_formats_are_different_identifiers() -> None:
    assert not lint([FrameLayout("A", 1, 8, ()), FrameLayout("B", 1 | EXTENDED, 8, ())])


def test_cantools_itself_lets_these_pass() -> None:
    """Why the rules exist: the parser takes each of these without a word of error."""
    for old, new in (("[0|14]", "[14|3]"), ("6.25E-005", "0"), ("BO_ 641 T", "BO_ 385 T"), ("[0|14]", "[-1|99]")):
        database: Any = cantools.database.load_string(DBC.read_text().replace(old, new), "dbc")
        assert len(database.messages) == 2
