"""Visits of many units read at once: the bits of one read alone, whatever the texts are like."""

import json
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from station.config.recipes import load_recipe
from station.domain.core.types import ReducedVisits
from station.domain.evaluation.reduced_visits_document import from_document
from station.domain.evaluation.reduced_visits_texts import BATCH, from_texts
from station.errors import LogError

RECIPE = load_recipe("six-point")
NAMES = tuple(p.name for p in RECIPE.positions)


def document(random: np.random.Generator, names: tuple[str, ...] = NAMES) -> dict[str, Any]:
    """Numbers of every length and size, as a log may hold them."""
    v = len(names)
    floats = {"mean": (v, 3), "cov": (v, 3, 3), "quantisation": (v, 3), "dof": (v, 3), "true": (v, 3), "std": (v, 3)}
    floats |= dict.fromkeys(("effective", "time_s", "temperature_degC"), (v,))
    made = {
        name: (random.standard_normal(shape) * 10.0 ** random.integers(-320, 300, shape)).tolist()
        for name, shape in floats.items()
    }
    whole = {name: random.integers(-9, 99_999, v).tolist() for name in ("run", "visit", "count")}
    return {**whole, "position": list(names), **made, "seating": ["home"] * v}


def same(found: ReducedVisits, expected: ReducedVisits) -> bool:
    pairs = ((getattr(found, f.name), getattr(expected, f.name)) for f in fields(found))
    return all(
        bits(a) == bits(b) if isinstance(a, np.ndarray) and isinstance(b, np.ndarray) else a == b for a, b in pairs
    )


def bits(values: np.ndarray) -> tuple[object, ...]:
    return values.dtype, values.shape, values.tobytes()


def assert_as_alone(texts: list[str]) -> None:
    found = list(from_texts(texts, RECIPE, {}))
    assert len(found) == len(texts)
    assert all(same(one, from_document(json.loads(text), RECIPE)) for one, text in zip(found, texts, strict=True))


def test_units_of_one_form_have_the_bits_of_each_alone() -> None:
    random = np.random.default_rng(1811)
    assert_as_alone([json.dumps(document(random), separators=(",", ":")) for _ in range(BATCH + 3)])


def test_other_forms_among_them_stay_what_they_are() -> None:
    random = np.random.default_rng(1812)
    documents = [document(random) for _ in range(12)]
    documents[1] = document(random, NAMES[:5])
    documents[2]["temperature_degC"] = [None] * 6
    documents[3]["temperature_degC"][4] = None
    documents[4] = dict(reversed(documents[4].items()))
    documents[5] |= {"later": [1.0, 2.0]}
    documents[6]["mean"][0] = [1, 2, 3]
    documents[7]["cov"][0][0][0] = 0
    documents[8]["position"][:2] = reversed(documents[8]["position"][:2])
    documents[11]["rounding"] = documents[11]["quantisation"]
    texts = [json.dumps(d, separators=(",", ":")) for d in documents]
    texts[9] = json.dumps(documents[9])
    texts[10] = json.dumps(documents[10], indent=1)
    assert_as_alone(texts)


def test_names_that_differ_in_digits_and_quotation_marks_are_not_mixed_up() -> None:
    reference = RECIPE.reference.model_copy(update={"pose": "unknown"})
    recipe, random = RECIPE.model_copy(update={"reference": reference}), np.random.default_rng(1813)
    names = ["tilt1", "tilt2", 'a"1', 'a"2', "b\\1", "-e1", "+E2"]
    texts = [json.dumps(document(random, (*NAMES, name)), separators=(",", ":")) for name in names]
    assert [visits.position[-1] for visits in from_texts(texts, recipe, {})] == names


@pytest.mark.parametrize("spoilt", ['{"run":[1,2', '{"run":[1,,2]}', "[]", "", "{}"])
def test_a_damaged_text_is_refused(spoilt: str) -> None:
    sound = json.dumps(document(np.random.default_rng(1814)), separators=(",", ":"))
    with pytest.raises(LogError):
        list(from_texts([sound, spoilt, sound], RECIPE, {}))


def test_a_damaged_number_among_sound_ones_is_refused() -> None:
    texts = [json.dumps(document(np.random.default_rng(1815)), separators=(",", ":")) for _ in range(3)]
    texts[1] = texts[1].replace("e-", "e--", 1)
    with pytest.raises(LogError):
        list(from_texts(texts, RECIPE, {}))
