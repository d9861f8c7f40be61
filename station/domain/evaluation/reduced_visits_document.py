"""Visits as the log keeps them beside the raw frames, so that a backtest need not decode a hundred thousand units."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from station.domain.core.types import ReducedVisits
from station.domain.recipe import references
from station.domain.recipe.recipe import Recipe
from station.domain.recipe.references import Truths
from station.errors import LogError

TEXT = ("position", "seating")
WHOLE = {"run": np.int32, "visit": np.int32, "count": np.int64}
#: What records of before rules 10 lack.
LATER = ("rounding",)
_FIELDS = tuple(f.name for f in fields(ReducedVisits))


def to_document(visits: ReducedVisits) -> dict[str, Any]:
    """Every field of the visits by name, as lists; a float that is no number becomes null in the log."""
    values = {name: getattr(visits, name) for name in _FIELDS}
    return {name: list(v) if name in TEXT else v.tolist() for name, v in values.items() if v is not None}


def from_document(document: Mapping[str, Any], recipe: Recipe, truths: Truths | None = None) -> ReducedVisits:
    """The visits at the recipe's positions, with the truth as `recipe` has it; a gold reference's reading as kept.

    truths: of this recipe, by positions and seatings, filled here: units of one fleet share them.
    Errors: LogError when the document lacks a field.
    """
    return at_recipe(stored_values(document), recipe, {} if truths is None else truths)


def stored_values(document: Mapping[str, Any]) -> dict[str, Any]:
    """Every field by its name, as the document has it. Errors: LogError when it lacks one."""
    try:
        names = (name for name in _FIELDS if name in document or name not in LATER)
        return {name: _value(name, document[name]) for name in names}
    except (KeyError, TypeError, ValueError) as exc:
        raise LogError("reduced-visits-damaged", why=str(exc)) from exc


def at_recipe(values: Mapping[str, Any], recipe: Recipe, truths: Truths) -> ReducedVisits:
    """Every field's values as visits at the recipe's positions, with the truth as `recipe` has it."""
    key = values["position"], values["seating"]
    # Visits of which the truth is known are all of the recipe.
    if recipe.pose_known and key not in truths:
        values = _at(values, {p.name for p in recipe.positions}, {"home", *recipe.seatings})
        key = values["position"], values["seating"]
    if recipe.reference.source != "gold":
        if key not in truths:
            truths[key] = references.true_vectors(recipe, *key)
        values = {**values, "true": truths[key]}
    return ReducedVisits(**values)


def _at(values: Mapping[str, Any], positions: set[str], seatings: set[str]) -> dict[str, Any]:
    """The rows at these positions and seatings: a changed recipe may leave some out."""
    names = zip(values["position"], values["seating"], strict=True)
    rows = [i for i, (position, seating) in enumerate(names) if position in positions and seating in seatings]
    return {name: tuple(v[i] for i in rows) if name in TEXT else v[rows] for name, v in values.items()}


def _value(name: str, stored: Any) -> Any:
    if name in TEXT:
        return tuple(stored)
    shape = [len(stored)]
    # Flattened here: numpy takes twice as long to walk nested lists.
    while stored and isinstance(stored[0], list):
        shape.append(_same_length(stored))
        stored = _joined(stored)
    # Null stands for NaN; numpy reads None as NaN when told to make floats.
    return np.array(stored, WHOLE.get(name, np.float64)).reshape(shape)


def _joined(rows: list[list[Any]]) -> list[Any]:
    joined: list[Any] = []
    for row in rows:
        joined += row
    return joined


def _same_length(rows: list[list[Any]]) -> int:
    lengths = set(map(len, rows))
    if len(lengths) > 1:
        raise ValueError(f"rows of {min(lengths)} and of {max(lengths)} values")
    return lengths.pop()
