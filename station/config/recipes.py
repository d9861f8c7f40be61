"""Recipes and products by name or path, read and checked."""

import re
from pathlib import Path

from station.config.documents import content_hash, load_document, validate
from station.config.search_path import find_file
from station.domain.methods import decision_rule
from station.domain.recipe import references
from station.domain.recipe.recipe import Recipe
from station.errors import RecipeError


def recipe_path(name: str | Path) -> Path:
    """The file of a recipe given by path or by name (`tilt-24` is `recipes/tilt-24.yaml`)."""
    text = str(name)
    bare = re.fullmatch(r"[\w+\-]+", text) is not None and not Path(text).is_file()
    return find_file(f"{text}.yaml" if bare else text, "recipes", None, RecipeError)


def load_recipe(name: str | Path) -> Recipe:
    """The recipe of that path or name. Errors: RecipeError with every mistake, its line and remedy."""
    path = recipe_path(name)
    recipe = validate(load_document(path, RecipeError), Recipe, RecipeError)
    try:
        decision_rule.refuse_unestimated(recipe)
        references.check_gravity(recipe)
    except RecipeError as exc:
        raise RecipeError("file-reason", file=str(path), reason=exc.message) from None
    return recipe


def recipe_hash(recipe: Recipe) -> str:
    """SHA-256 of the recipe's content, comments and key order apart: the same recipe has the same hash."""
    return content_hash(recipe)
