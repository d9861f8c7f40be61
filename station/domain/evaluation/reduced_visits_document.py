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

_TEXT = ("position", "seating")
_WHOLE = {"run": np.int32, "visit": np.int32, "count": np.int64}


def to_document(visits: ReducedVisits) -> dict[str, Any]:
    """Every field of the visits by name, as lists; a float that is no number becomes null in the log."""
    values = {f.name: getattr(visits, f.name) for f in fields(ReducedVisits)}
    return {name: list(v) if name in _TEXT else v.tolist() for name, v in values.items()}


def from_document(document: Mapping[str, Any], recipe: Recipe, truths: Truths | None = None) -> ReducedVisits:
    """The visits at the recipe's positions, with the truth as `recipe` has it; a gold reference's reading as kept.

    truths: of this recipe, by positions and seatings, filled here: units of one fleet share them.
    Errors: LogError when the document lacks a field.
    """
    try:
        values = {f.name: _value(f.name, document[f.name]) for f in fields(ReducedVisits)}
    except (KeyError, TypeError, ValueError) as exc:
        raise LogError("reduced-visits-damaged", why=str(exc)) from exc
    key, known = (values["position"], values["seating"]), {} if truths is None else truths
    # Visits of which the truth is known are all of the recipe.
    if recipe.pose_known and key not in known:
        values = _at(values, {p.name for p in recipe.positions}, {"home", *recipe.seatings})
        key = values["position"], values["seating"]
    if recipe.reference.source != "gold":
        values["true"] = known[key] = known[key] if key in known else references.true_vectors(recipe, *key)
    return ReducedVisits(**values)


def _at(values: Mapping[str, Any], positions: set[str], seatings: set[str]) -> dict[str, Any]:
    """The rows at these positions and seatings: a changed recipe may leave some out."""
    names = zip(values["position"], values["seating"], strict=True)
    rows = [i for i, (position, seating) in enumerate(names) if position in positions and seating in seatings]
    return {name: tuple(v[i] for i in rows) if name in _TEXT else v[rows] for name, v in values.items()}


def _value(name: str, stored: Any) -> Any:
    if name in _TEXT:
        return tuple(stored)
    # Null stands for NaN; numpy reads None as NaN when told to make floats.
    return np.array(stored, _WHOLE.get(name, np.float64))
