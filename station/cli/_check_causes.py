"""What a recipe can and cannot tell apart, as a part of `station check`."""

from typing import Any

from station.cli._layout import TextTable
from station.diagnosis.planning.plan import RecipeSeparability, recipe_separability
from station.domain.recipe.recipe import Recipe
from station.reporting.diagnosis.quantity_format import unit_words

#: Units that are thought of.
ASSUMED_UNITS = 4
#: A cause of this distance is found in 8 of 10 campaigns.
FOUND_AT_D = 3.3


def distinguishable_causes(recipe: Recipe) -> tuple[dict[str, Any], tuple[str | TextTable, ...]]:
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


def _lines(found: RecipeSeparability) -> tuple[str | TextTable, ...]:
    rows = []
    for s in sorted(found.shown, key=lambda s: (bool(s.indistinguishable_from), s.effect)):
        remarks = [f"cannot be told from {', '.join(s.indistinguishable_from)}"] if s.indistinguishable_from else []
        if s.d <= FOUND_AT_D:
            remarks.append("its usual size is too small for this recipe")
        size = f"{s.smallest:.2g}{'' if s.unit == '1' else ' ' + unit_words(s.unit)}"
        rows.append((s.effect, size, "; ".join(remarks)))
    title = (
        f"causes that {found.units} units through this recipe show (white noise of the data sheet; smallest size found "
        "in 8 of 10 campaigns):"
    )
    hidden = (f"  not shown at all: {', '.join(found.hidden)}",) if found.hidden else ()
    return title, TextTable(("cause", "smallest", "remark"), rows, words=frozenset({2}), indent=2), *hidden
