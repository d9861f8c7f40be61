"""The recipe that the blind tests tumble by, at a sample rate that keeps them quick."""

from functools import cache

from station.config.recipes import load_recipe
from station.domain.recipe.recipe import Recipe

#: Samples a second; the noise of a dwell's mean follows from the density, not from this.
RATE_HZ = 25.0


@cache
def recipe(runs: int = 3) -> Recipe:
    """tilt-24 with the first so many of its runs."""
    whole = load_recipe("tilt-24")
    device = whole.device.model_copy(update={"rate_hz": RATE_HZ, "lsb": 0.0})
    return whole.model_copy(update={"device": device, "runs": whole.runs[:runs]})


def six_faces(*orders: str) -> Recipe:
    """The faces of a cube in some orders."""
    faces = load_recipe("six-point")
    runs = tuple(recipe().runs[0].model_copy(update={"order": order}) for order in orders)
    device = faces.device.model_copy(update={"rate_hz": RATE_HZ, "lsb": 0.0})
    return faces.model_copy(update={"runs": runs, "device": device})
