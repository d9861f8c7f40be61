"""What a recipe can and cannot tell apart, as a part of `station check`."""

from typing import Any

from station.diagnosis.planning.plan import RecipeSeparability, recipe_separability
from station.domain.recipe.recipe import Recipe

#: Units that are thought of.
ASSUMED_UNITS = 4


def distinguishable_causes(recipe: Recipe) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The table for programs, and its lines for people."""
    found = recipe_separability(recipe, ASSUMED_UNITS)
    rows = [
        {
            "effect": s.effect,
            "typical": s.typical,
            "unit": s.unit,
            "d": s.d,
            "smallest_found": s.smallest,
            "cannot_tell_from": list(s.indistinguishable_from),
        }
        for s in found.shown
    ]
    return {"units": found.units, "causes": rows, "not_testable": list(found.hidden)}, _lines(found)


def _lines(found: RecipeSeparability) -> tuple[str, ...]:
    width = max((len(s.effect) for s in found.shown), default=0)
    lines = [
        f"causes that {found.units} units through this recipe show (white noise of the data sheet; smallest size found "
        "in 8 of 10 campaigns):"
    ]
    for s in sorted(found.shown, key=lambda s: (bool(s.indistinguishable_from), s.effect)):
        tied = f"; cannot be told from {', '.join(s.indistinguishable_from)}" if s.indistinguishable_from else ""
        weak = "" if s.d > 3.3 else "; its usual size is too small for this recipe"
        lines.append(f"  {s.effect:<{width}}  {s.smallest:.2g} {s.unit}{tied}{weak}")
    if found.hidden:
        lines.append(f"  not to be seen at all: {', '.join(found.hidden)}")
    return tuple(lines)
