"""No line of a budget is a default that is not listed."""

from typing import Any

import numpy as np
import pytest
import yaml

from station.config.search_path import shipped_folder
from station.domain.planning.forecast import forecast
from station.domain.recipe import assumptions
from station.domain.recipe.recipe import Recipe
from station.reporting.certificate import facts

RECIPES = shipped_folder() / "recipes"
#: Lines that readings show by themselves (Type A).
ESTIMATED = {"noise", "quantisation"}
#: Any of these keys tells of the line.
DISCLOSED_BY = {
    "converter": {"device.rounding"},
    "position": {"reference.pose_std_deg"},
    "scatter": {"residuals"},
    "gravity": {"reference.magnitude_std"},
    "field": {"reference.magnitude_std"},
    "rate": {"reference.magnitude_std"},
    "magnitude": {"reference.magnitude_std"},
    "Earth rate": {"reference.site.heading_deg"},
    "g-sensitivity": {"device.g_sensitivity"},
    "gold reference": {"reference.gold.offset_std", "reference.gold.gain_std", "reference.gold.seat_std_deg"},
    "nest tilt": {"reference.nest_std_deg"},
    "base tilt": {"reference.base_std_deg"},
    "field direction": {"reference.field_std_deg"},
    "temperature": {"device.offset_tempco", "device.gain_tempco"},
    "runs": {"device.turn_on_std"},
    "method": {"device.gain_std", "device.cross_std"},
}
STATED = {
    "reference": ("magnitude_std", "nest_std_deg", "base_std_deg", "field_std_deg", "pose_std_deg", "site"),
    "device": ("rounding", "gain_std", "cross_std", "g_sensitivity", "offset_tempco", "gain_tempco"),
}


def silent(document: dict[str, Any]) -> Recipe:
    """The recipe without what it states of errors."""
    own = {**document}
    for block, keys in STATED.items():
        own[block] = {k: v for k, v in own.get(block, {}).items() if k not in keys}
    return Recipe.model_validate({k: v for k, v in own.items() if k not in ("limits", "verify")})


@pytest.mark.parametrize("name", sorted(p.stem for p in RECIPES.glob("*.yaml") if "hand-held" not in p.stem))
def test_every_line_of_a_silent_recipe_s_budget_is_listed_as_assumed(name: str) -> None:
    recipe = silent(yaml.safe_load((RECIPES / f"{name}.yaml").read_text(encoding="utf-8")))
    assert_disclosed(recipe)


def test_of_a_gold_reference_what_its_certificate_did_not_say_is_listed() -> None:
    document = yaml.safe_load((RECIPES / "six-point.yaml").read_text(encoding="utf-8"))
    gold = {"serial": "G1", "due": "2099-01-01"}
    document["reference"] = {"source": "gold", "gold": gold}
    recipe = silent(document)
    assert_disclosed(recipe)
    stated = {**gold, "offset_std": 0.0, "gain_std": 0.0, "seat_std_deg": 0.0}
    document["reference"]["gold"] = stated
    left = {a.key for a in assumptions.listing(silent(document)) if not a.stated}
    assert not any("gold" in key for key in left)


def test_a_certificate_lists_the_offset_of_another_power_on_as_its_budget_held_it() -> None:
    recipe = silent(yaml.safe_load((RECIPES / "six-point.yaml").read_text(encoding="utf-8")))

    def listed(parts: dict[str, float]) -> dict[str, float]:
        return {a.key: a.value for a in facts.assumed(recipe, {"budget": [{"parts": parts}]})}

    assert listed({"runs": 5e-4})["device.turn_on_std"] == 5e-4
    assert listed({"runs": 0.0})["device.turn_on_std"] == 0.0


def assert_disclosed(recipe: Recipe) -> None:
    listed = {a.key for a in assumptions.listing(recipe) if not a.stated}
    parts = forecast(recipe, np.zeros(12)).budget.parts
    lines = {cause for cause, part in parts.items() if np.diagonal(part).any()} - ESTIMATED
    assert lines - DISCLOSED_BY.keys() == set()
    assert [cause for cause in sorted(lines) if not DISCLOSED_BY[cause] & listed] == []
