"""KCD, SYM and ARXML beside DBC: one layout, whatever describes the frames; one sentence for what cannot be read."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from cantools import database

from station.adapters.dbc import read_layouts
from station.domain.can.signals import FrameLayout
from station.errors import ProductError
from station.messages import render

ROOT = Path(__file__).parents[2]

DBCS = sorted((ROOT / "dbc").rglob("*.dbc"))


def as_kind(dbc: Path, kind: str, folder: Path) -> Path:
    parsed: Any = database.load_file(dbc, sort_signals=None)
    path = folder / f"{dbc.stem}.{kind}"
    path.write_text(parsed.as_kcd_string() if kind == "kcd" else parsed.as_sym_string(), encoding="utf-8")
    return path


def decoding(layout: FrameLayout) -> FrameLayout:
    """What matters to decoding: formats differ in how they write limits."""
    ordered = sorted(layout.signals, key=lambda signal: signal.name)
    return replace(layout, signals=tuple(replace(s, minimum=None, maximum=None) for s in ordered))


@pytest.mark.parametrize("kind", ["kcd", "sym"])
@pytest.mark.parametrize("dbc", DBCS, ids=lambda path: path.stem)
def test_another_format_gives_the_layout_of_the_dbc(dbc: Path, kind: str, tmp_path: Path) -> None:
    expected = read_layouts(dbc, {})
    found = read_layouts(as_kind(dbc, kind, tmp_path), {})
    assert {n: decoding(found[n]) for n in expected} == {n: decoding(layout) for n, layout in expected.items()}


KCD = """<NetworkDefinition xmlns="http://kayak.2codeornot2code.org/1.0"><Document/><Bus name="B">
<Message id="0x181" name="ACC" length="6">
<Signal name="X" offset="0" length="16"><Value type="signed" slope="0.001" unit="g"/></Signal>
<Signal name="Y" offset="OFFSET" length="16"><Value type="signed" slope="0.001" unit="g" min="-9" max="99"/></Signal>
</Message></Bus></NetworkDefinition>"""
SYM = 'FormatVersion=5.0 // of before\nTitle="x"\n\n{SEND}\n\n[A]\nID=123h\nDLC=8\nVar=X unsigned 0,8\n'


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.kcd", KCD.replace("OFFSET", "8"), "The signals Y and X are overlapping in message ACC"),
        ("a.kcd", KCD[:300], "cannot be read as KCD (unclosed token: line 4, column 45)"),
        ("a.kcd", "<!DOCTYPE x>" + KCD, "declares an XML document type"),
        ("a.kcd", re.sub(r"(?s)<Message.*</Message>", "", KCD), "holds no message with signals"),
        ("a.sym", SYM, "cannot be read as SYM (Only SYM version 6.0 is supported): correct it, or export it as a DBC"),
        ("a.sym", "", "cannot be read as SYM (Only SYM version 6.0 is supported)"),
        ("a.arxml", "<AUTOSARGH/>", "cannot be read as ARXML (No XML namespace specified"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_sentence(name: str, text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ProductError) as refused:
        read_layouts(path, {"ACC": ["X", "Y"]})
    sentence = render(refused.value.message)
    assert said in sentence
    assert str(path) in sentence


def test_a_limit_that_cannot_be_is_named_with_its_line_where_it_is_used(tmp_path: Path) -> None:
    path = tmp_path / "a.KCD"
    path.write_text(KCD.replace("OFFSET", "16"))
    assert list(read_layouts(path, {"ACC": ["X"]})) == ["ACC"]
    with pytest.raises(ProductError, match=r"line 4, ACC.Y: maximum 99 cannot be reached"):
        read_layouts(path, {"ACC": ["Y"]})
