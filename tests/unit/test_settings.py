"""config.yaml: what it may say, and every mistake with line, key and remedy."""

import os
from pathlib import Path

import pytest

from station.config.documents import load_document
from station.config.products import load_product, product_path
from station.config.recipes import recipe_path
from station.config.search_path import find_file, shipped_folder
from station.config.settings import load_config, load_settings
from station.errors import ConfigError, ProductError, RecipeError

GOOD = """\
station: bench-7
nests:
  - {name: A, node: 0x11}
  - {name: B, node: 18}
positioner: {kind: simulated, speed_deg_s: 45}
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "config.yaml"
    path.write_text(text)
    return path


def test_the_shipped_config_is_good() -> None:
    settings = load_settings(shipped_folder() / "config.yaml")
    assert [n.node for n in settings.nests] == [0x11, 0x12, 0x13, 0x14]
    assert settings.bus.interface == "socketcan"


def test_a_positioner_keeps_its_own_keys(tmp_path: Path) -> None:
    settings, document = load_config(written(tmp_path, GOOD))
    assert settings.positioner.options == {"speed_deg_s": 45}
    assert document.part("positioner").line(("speed_deg_s",)) == 5


def test_files_may_lie_deep(tmp_path: Path) -> None:
    deep = "/srv/" + "a folder of the plant/" * 8
    text = GOOD + f"database: {deep}station.db\nsigning_key: {deep}key\ngolden: {{file: '{deep}golden.json'}}\n"
    settings = load_settings(written(tmp_path, text))
    assert settings.golden is not None
    assert {settings.database, settings.signing_key, settings.golden.file} == {
        f"{deep}{name}" for name in ("station.db", "key", "golden.json")
    }


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("node: 18", "node: 0x11"), "nests A and B both have node 17; change one"),
        (("name: B", "name: A"), "nest A is listed twice"),
        (("node: 18", "node: 128"), "line 4, key `nests.1.node`"),
        (("station: bench-7", "statoin: bench-7"), "line 1, key `statoin`: unknown key; did you mean `station`?"),
        (("nests:", "nets:"), "key `nests`: is missing"),
        (("station: bench-7", "timeouts: {sdo_s: -1}"), "greater than 0"),
    ],
)
def test_a_mistake_is_one_sentence_with_its_place(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_settings(written(tmp_path, GOOD.replace(*change)))
    assert words in caught.value.sentence
    assert "config.yaml, line" in caught.value.sentence


def test_a_file_is_found_beside_what_names_it_then_here_then_as_shipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "line" / "recipes").mkdir(parents=True)
    (tmp_path / "line" / "dbc").mkdir()
    recipe = tmp_path / "line" / "recipes" / "mine.yaml"
    recipe.write_text("x")
    own = tmp_path / "line" / "dbc" / "accelerometer.yaml"
    monkeypatch.chdir(tmp_path)
    assert product_path("accelerometer", recipe) == shipped_folder() / "dbc" / "accelerometer.yaml"
    own.write_text("x")
    assert product_path("accelerometer", recipe).resolve() == own.resolve()
    monkeypatch.chdir(tmp_path / "line")
    assert recipe_path("mine") == Path("recipes/mine.yaml")
    assert recipe_path("six-point") == shipped_folder() / "recipes" / "six-point.yaml"
    assert recipe_path(recipe) == recipe


def test_what_is_nowhere_names_the_places_that_were_searched() -> None:
    with pytest.raises(RecipeError, match=r"There is no no-such\.yaml in \., recipes, .*recipes; check the name"):
        find_file("no-such.yaml", "recipes", None, RecipeError)


def test_a_mistyped_name_is_answered_with_the_nearest_that_is_there() -> None:
    with pytest.raises(RecipeError, match=r"There is no six-pont\.yaml in .*; did you mean six-point\.yaml\?"):
        find_file("six-pont.yaml", "recipes", None, RecipeError)


@pytest.mark.parametrize("target", ["loop.yaml", "nowhere.yaml"])
def test_a_link_that_leads_nowhere_is_found_and_cannot_be_read(target: str, tmp_path: Path) -> None:
    link = tmp_path / "loop.yaml"
    link.symlink_to(target)
    with pytest.raises(RecipeError, match=r"loop\.yaml cannot be read"):
        load_document(find_file(os.path.relpath(link), "recipes", None, RecipeError), RecipeError)


@pytest.mark.parametrize("name", ["../secret", "/etc/passwd", "a/b", "..", ".", ""])
def test_a_product_name_cannot_leave_its_folder(name: str) -> None:
    with pytest.raises(ProductError, match="is not a plain name"):
        product_path(name)


def test_the_shipped_product_is_good() -> None:
    assert load_product("accelerometer").map.stores == "forward"
