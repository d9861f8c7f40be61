"""A formula written as an effect file: it does what the tree does, reads like the others, and refuses bad names."""

import ast
import dataclasses
import doctest
import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from station.cli.app import main
from station.model.campaign import scene_of_plan
from station.model.effect import PoseEffect, SensorEffect
from station.model.formula.effect_file import SizeMet, class_name, effect_source, is_reserved
from station.model.formula.term import Term
from station.model.formula.term_effect import effect_of
from station.model.forward import ActiveEffect, BaseResponse, forward
from tests.blind.recipes import recipe
from tests.unit.test_formula_grammar import ALL

MODEL = """schema: station.model/1
effects:
- effect: formula-1
  parameters: [{name: coefficient, axis: z, of: common, value: 2.0e-05, unit: 1/(g·degC)}]
  term:
    input: own-squared
    modulator: temperature
    axes: [z]
    of: common
    constants: {about_degC: 25.0}
    unit: 1/(g·degC)
    source: found in data 1f2e3d4c5b6a7980, d 16; not yet explained
"""


def code(asked: list[str]) -> int:
    """The exit code of a command."""
    with pytest.raises(SystemExit) as ended:
        main(asked)
    return int(ended.value.code or 0)


def loaded(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"adopted_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module.__name__] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("term", ALL[::13], ids=lambda t: "-".join(t.family))
def test_the_file_does_what_the_tree_does(term: Term, tmp_path: Path) -> None:
    path = tmp_path / "found_law.py"
    path.write_text(effect_source(term, "found-law", SizeMet.once(1e-3), "found in data 00ff, d 12"), encoding="utf-8")
    assert max(len(line) for line in path.read_text().splitlines()) <= 130
    module = loaded(path)
    kind: Any = getattr(module, class_name("found-law"))
    assert issubclass(kind, PoseEffect | SensorEffect)
    failed, tried = doctest.testmod(module)
    assert tried > 0 and failed == 0
    scene = scene_of_plan(recipe(), ("A",), seed=1)
    ours, theirs = effect_of(term, "found-law", 1e-3), kind.example()
    groups = len(scene.group(term.of)[1])
    c = 1e-3 * np.random.default_rng(1).standard_normal((groups, len(ours.axes)))
    base = BaseResponse.ideal(1)
    one, two = (forward(scene, base, {"x": ActiveEffect(e, c, term.of)}) for e in (ours, theirs))
    np.testing.assert_allclose(one, two, rtol=1e-4, atol=1e-8)
    assert {p.field for p in theirs.forms} == {f.name for f in dataclasses.fields(theirs)} - {"size"}
    assert theirs.physics.endswith(".") and 20 < len(theirs.physics) <= 120


def test_no_effect_takes_the_name_of_a_class_that_its_file_imports() -> None:
    for term in ALL[::13]:
        lines = effect_source(term, "found-law", SizeMet.once(1e-3), "found in data 00ff").splitlines()
        imports = "\n".join(
            line.removeprefix(">>> ") for line in lines if " import " in line and "import np" not in line
        )
        names = [alias.name for node in ast.walk(ast.parse(imports)) for alias in getattr(node, "names", ())]
        words = [re.sub(r"(?<=[a-z])(?=[A-Z])", "-", name).lower() for name in names if name[0].isupper()]
        assert len(words) >= 2 and all(map(is_reserved, words))


def test_a_model_file_becomes_an_effect_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = tmp_path / "model.yaml"
    model.write_text(MODEL, encoding="utf-8")
    asked = ["effects", "--write-hypothesis", "thermal-square", "--model", str(model), "--into", str(tmp_path)]
    assert code(asked) == 0
    text = (tmp_path / "thermal_square.py").read_text(encoding="utf-8")
    assert "class ThermalSquare(SensorEffect):" in text
    assert "found in data 1f2e3d4c5b6a7980" in text
    assert code(asked) == 2
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("input: own-squared", "input: own-quartic", "line 5, key `effects.0.term`: input 'own-quartic' is not in the"),
        ("modulator: temperature", "modulator: os.system", "modulator 'os.system' is not in the grammar"),
        ("unit: 1/(g·degC)\n    source", "unit: g\n    source", "Unit 'g' does not fit the formula"),
        (
            "value: 2.0e-05, unit: 1/(g·degC)",
            "value: 2.0e-05, unit: g/s",
            "'g/s' is not that of coefficient, which is in 1/(",
        ),
        ("about_degC: 25.0", "about_degC: 1e9", "Constant about_degC is 1e+09; write a number from -300 to 400"),
        ("about_degC: 25.0", "tau: 3", "constants are about_degC, not tau"),
        ("axes: [z]", "axes: [w]", "axes w are not those of this formula"),
        ("axis: z", "axis: x", "formula-1 has no axis 'x'; it has z"),
        ("value: 2.0e-05", "value: '__import__(\"os\")'", "line 4, key `effects.0.parameters.0.value`: Size"),
        ("source: found", 'source: "\\"\\"\\"\\nimport os" #', "source"),
        ("    of: common\n    con", "    of: everybody\n    con", "of 'everybody' is not in the grammar"),
    ],
)
def test_a_formula_edited_by_hand_is_refused_with_its_place(
    old: str, new: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "model.yaml"
    assert old in MODEL
    model.write_text(MODEL.replace(old, new, 1), encoding="utf-8")
    out = str(tmp_path / "s.csv")
    assert code(["simulate", "--recipe", "tilt-24", "--units", "1", "--model", str(model), "--out", out]) == 2
    said = capsys.readouterr().err
    assert says in said and "model.yaml" in said and said.count("\n") == 1


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        (["--write-hypothesis", "new"], "needs the model file"),
        (["--write-hypothesis", "../evil", "--model", "MODEL"], "is no name of an effect"),
        (["--write-hypothesis", "cubic", "--model", "MODEL"], "There is an effect cubic already"),
        *(
            (["--write-hypothesis", name, "--model", "MODEL"], f"{name} stands for something else")
            for name in ("none", "lambda", "signal", "exception", "simple-namespace", "formula-12")
        ),
        (["--write-hypothesis", "new", "--model", "MODEL", "--formula", "formula-7"], "say which with --formula"),
    ],
)
def test_a_wrong_wish_is_one_sentence(
    asked: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "model.yaml"
    model.write_text(MODEL, encoding="utf-8")
    assert code(["effects", *(str(model) if x == "MODEL" else x for x in asked)]) == 2
    assert says in capsys.readouterr().err
