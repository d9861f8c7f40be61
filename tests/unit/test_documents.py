"""YAML in, checked data out: every mistake in one sentence with file and line, hostile text in bounded time."""

import time
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from station.config.documents import Document, content_hash, load_document, parse_plain_scalar, validate
from station.config.recipes import load_recipe, recipe_hash
from station.domain.recipe.recipe import Recipe
from station.errors import RecipeError

GOOD = """\
schema: station.recipe/1
name: six
version: 1
sensor: accelerometer
unit: g
reference: {source: gravity, magnitude: 1.0}
positions:
  - {name: z-up, up: +z}
  - name: x-up
    up: +x
"""


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "some.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def sentence(path: Path) -> str:
    with pytest.raises(RecipeError) as caught:
        validate(load_document(path, RecipeError), Recipe, RecipeError)
    assert "\n" not in caught.value.sentence
    assert str(path) in caught.value.sentence
    return caught.value.sentence


def test_lines_of_keys_and_items(tmp_path: Path) -> None:
    document = load_document(written(tmp_path, GOOD))
    assert document.line(("unit",)) == 5
    assert document.line(("positions", 0)) == 8
    assert document.line(("positions", 1, "up")) == 10
    assert document.line(("positions", 1, "nowhere", 3)) == 9


def test_a_part_keeps_the_lines_of_the_file(tmp_path: Path) -> None:
    part = load_document(written(tmp_path, GOOD)).part("positions", 1)
    assert part.data == {"name": "x-up", "up": "+x"}
    assert part.line(("up",)) == 10


@pytest.mark.parametrize(
    ("change", "line", "words"),
    [
        (("unit: g", "unti: g"), 5, "did you mean `unit`"),
        (("name: six", "name: six\nname: seven"), 3, "appears twice"),
        (("up: +z", "upp: +z"), 8, "did you mean `up`"),
        (("magnitude: 1.0", "magnitud: 1.0"), 6, "did you mean `magnitude`"),
        (("name: x-up", "name: z-up"), 1, "listed twice"),
        (("up: +z", "quaternion: [1, 1, 0, 0]"), 8, "not a rotation"),
        (("up: +z", "quaternion: [.nan, 0, 0, 0]"), 8, "finite"),
        (("version: 1", "version: 1\nlimits: {offset: -3}"), 4, "greater than 0"),
        (("version: 1", "version: 1\nlimits: {temperature_degC: [40, 10]}"), 4, "is empty; the lower limit"),
        (("version: 1", "version: 0x" + "f" * 5000), 3, "version"),
        (("version: 1", "version: *a"), 3, "alias *a has no complete anchor"),
        (("version: 1", "version: &a [*a]"), 3, "alias *a has no complete anchor"),
        (("version: 1", "version: !!python/object/apply:os.system [ls]"), 3, "tag"),
        (("version: 1", "version: {a: [}"), 3, "no value begins with }"),
        (("version: 1", "version: @at"), 3, "no value begins with @"),
        (("version: 1", "version: {a: 1"), 4, "the { of line 3 is not closed"),
        (("version: 1", "version: 'one"), 3, "the quotation mark of line 3 is never closed"),
        (("version: 1", 'version: "\\q"'), 3, "is no escape"),
        (("version: 1", "version: one: 1"), 3, "a colon is not allowed here"),
        (("version: 1", "version: 1\n- two"), 4, "a key or an entry of a list is expected here"),
        (("version: 1", "\tversion: 1"), 3, "indent with blanks"),
        (("version: 1", "version: *"), 3, "want a name after them"),
        (("version: 1", "version: |text"), 3, "begins on the next line"),
        (("version: 1", "version: !<x y"), 3, "tag ! is not allowed"),
        (("version: 1", "version: \ufffe"), 3, "U+FFFE"),
        (("version: 1", "version: 1\n---\na: 1"), 4, "second document"),
        (("version: 1", 'version: "\\x07"'), 3, "U+0007"),
        (("six", "si\u202ex"), 2, "U+202E"),
        (("sensor: accelerometer", "sensor: 3\nmethod: guess"), 4, "'3' is unknown"),
    ],
)
def test_every_mistake_is_one_sentence_with_its_line(
    tmp_path: Path, change: tuple[str, str], line: int, words: str
) -> None:
    printed = sentence(written(tmp_path, GOOD.replace(*change, 1)))
    assert words in printed
    assert f"line {line}" in printed


def test_all_mistakes_at_once_in_the_order_of_the_file(tmp_path: Path) -> None:
    printed = sentence(written(tmp_path, GOOD.replace("unit: g", "unit: kg").replace("up: +x", "up: +w")))
    assert 0 < printed.index("line 5, key `unit`") < printed.index("line 10, key `positions.1.up`")


def test_a_missing_key_is_named(tmp_path: Path) -> None:
    assert "key `name`: is missing" in sentence(written(tmp_path, GOOD.replace("name: six\n", "")))


@pytest.mark.parametrize(
    "raw",
    [
        b"\xff\xfe\x00",
        b"a: \x00",
        b"",
        b"- 1",
        b"just words",
        b"a: " + b"x" * 1_000_001,
        b"[" * 900_000,
        b"{a: " * 100_000,
        b"- " * 400_000,
        b"? [a]\n: b",
        b"a: !!binary x",
        b"a: &a [x,x,x,x,x,x,x,x,x]\n"
        + b"".join(b"%c: &%c [%s]\n" % (c, c, b",".join([b"*%c" % (c - 1)] * 9)) for c in range(98, 110)),
        b"%YAML 9.9\n---\na: 1",
        b"a: 1\n" + b"".join(b"k%d: 1\n" % i for i in range(30_000)),
    ],
)
def test_hostile_files_end_in_a_sentence_soon(tmp_path: Path, raw: bytes) -> None:
    begin_s = time.process_time()
    assert len(sentence(written(tmp_path, raw))) < 4000
    assert time.process_time() - begin_s < 5


def test_an_alias_is_what_its_anchor_was(tmp_path: Path) -> None:
    text = "a: &one {x: [1, 2]}\nb: *one\nc: [*one, &two 3, *two]\n"
    one = {"x": [1, 2]}
    document = load_document(written(tmp_path, text))
    assert document.data == {"a": one, "b": one, "c": [one, 3, 3]}
    assert document.line(("c", 0, "x", 1)) == 3


def test_an_absent_file_is_named(tmp_path: Path) -> None:
    assert "cannot be read" in sentence(tmp_path / "absent.yaml")
    assert "cannot be read" in sentence(tmp_path)


@given(st.binary(max_size=300))
def test_any_bytes_give_data_or_a_sentence(tmp_path_factory: Any, raw: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_bytes(raw)
    try:
        document = load_document(path, RecipeError)
    except RecipeError as exc:
        assert str(path) in exc.sentence
    else:
        assert isinstance(document, Document)


Plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**12), 10**12)
    | st.floats(allow_nan=False)
    | st.text("abc 123-", max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text("abcde", min_size=1), inner, max_size=4),
    max_leaves=20,
)


@given(Plain)
def test_what_yaml_writes_is_read_back(tmp_path_factory: Any, data: Any) -> None:
    path = tmp_path_factory.getbasetemp() / "round.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    assert load_document(path).data == data


@pytest.mark.parametrize(
    ("text", "value"),
    [("off", "off"), ("2027-03-01", "2027-03-01"), ("1e-4", 1e-4), ("0x11", 17), ("010", 10), ("~", None), ("+z", "+z"),
     ("True", True), ("-.inf", float("-inf")), ("1:30", "1:30"), (".", "."), ("1_000", "1_000")],
)  # fmt: skip
def test_plain_scalars_follow_yaml_1_2(text: str, value: object) -> None:
    assert parse_plain_scalar(text) == value
    assert type(parse_plain_scalar(text)) is type(value)


def test_the_hash_is_of_the_content_not_of_the_text(tmp_path: Path) -> None:
    first = load_recipe(written(tmp_path, GOOD))
    lines = GOOD.splitlines()
    commented = "# words\n" + "\n".join([*lines[1:6], lines[0], *lines[6:]])
    assert recipe_hash(load_recipe(written(tmp_path, commented))) == recipe_hash(first)
    assert recipe_hash(load_recipe(written(tmp_path, GOOD.replace("version: 1", "version: 2")))) != recipe_hash(first)
    assert recipe_hash(first) == content_hash(first)


@pytest.mark.parametrize(
    ("name", "text"), [("sensor.dbc", 'VERSION ""\nNS_ :\nBS_:\n'), ("faces.csv", "t,x,y,z\n0,1,2,3\n")]
)
def test_another_kind_of_file_is_told_so_and_not_its_first_colon(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(RecipeError, match=rf"{name} is no YAML file but ends in"):
        load_document(tmp_path / name, RecipeError)
