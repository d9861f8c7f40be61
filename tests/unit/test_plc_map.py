"""The map of a PLC's registers: what is wrong in it is refused with line and remedy, before anything is opened."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.config.documents import load_document, validate
from station.domain.cell import plc_view, register_map
from station.domain.cell.register_map import INPUTS, OUTPUTS, RegisterMap
from station.errors import ConfigError

SHIPPED = Path(__file__).resolve().parents[2] / "cells" / "cell.yaml"


def load(path: Path) -> RegisterMap:
    return validate(load_document(path, ConfigError), RegisterMap, ConfigError)


def test_the_shipped_map_is_the_default() -> None:
    assert load(SHIPPED) == RegisterMap()


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("fault: 4\n", "fault: 3\n", "status and fault both lie in register 3"),
        ("fault: 4\n", "fault: 8\n", "both lie in register 8"),
        ("heartbeat: 101", "heartbeat: 1", "heartbeat and heartbeat both lie in register 1"),
        ("bins-taken: 28 ", "bins-taken: 400 ", "span 402 registers"),
        ("bins-taken: 28 ", "bin-taken: 28 ", "did you mean bins-taken"),
        ("    stop: 113\n", "", "have no place: stop"),
        ("protocol: 1  ", "protocol: 2  ", "protocol 2 is not one this station speaks"),
        ("moving: 3", "moving: 2", "both lie in bit 2"),
        ("part-removed: 6", "part-gone: 6", "There is no signal 'part-gone'"),
        ("sound: 6", "sound: 16", "16"),
        ("word_order: high-first", "word_order: middle", "word_order"),
        ("device: 1 ", "device: 300 ", "device"),
    ],
)
def test_a_wrong_map_is_refused(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    text = SHIPPED.read_text(encoding="utf-8")
    assert old in text
    file = tmp_path / "cell.yaml"
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ConfigError) as refused:
        load(file)
    assert sentence in refused.value.sentence
    assert "cell.yaml" in refused.value.sentence


@given(st.lists(st.integers(-(2**31), 2**31 - 1), min_size=1, max_size=4), st.sampled_from(["high-first", "low-first"]))
def test_numbers_come_back_from_their_words(values: list[int], order: str) -> None:
    plc = RegisterMap.model_validate({"word_order": order})
    words = register_map.words_from(plc, "i32", tuple(values))
    assert all(0 <= word <= 0xFFFF for word in words)
    assert register_map.numbers_of(plc, "i32", words) == tuple(values)


@given(st.integers(0, 65535))
def test_the_next_number_differs_and_is_never_none(echo: int) -> None:
    assert 0 < plc_view.next_number(echo) < 65536
    assert plc_view.next_number(echo) != echo


def test_a_block_is_read_in_one_request() -> None:
    plc = RegisterMap()
    assert len(register_map.span(plc.inputs.at, INPUTS)) <= 125
    assert len(register_map.span(plc.outputs.at, OUTPUTS)) <= 123
