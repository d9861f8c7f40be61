"""Where the true stimulus comes from, and how wrong it may be."""

from collections.abc import Mapping

import numpy as np

from station.domain.core.types import Floats
from station.domain.recipe import assumptions, gravity, readings, sensor
from station.domain.recipe.recipe import Recipe
from station.domain.recipe.reference_block import GoldReference
from station.errors import RecipeError, ReferenceOverdue

#: Nominal stimulus (v, 3) by positions and seatings: units of one fleet share it.
Truths = dict[tuple[tuple[str, ...], tuple[str, ...]], Floats]


def true_vectors(recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...]) -> Floats:
    """Nominal stimulus (v, 3) in the device's frame for visits by name; NaN where the pose is unknown."""
    if not recipe.pose_known:
        return np.full((len(position), 3), np.nan)
    return recipe.perfect_reading(_felt_vectors(recipe, position, seating))


def _felt_vectors(recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...]) -> Floats:
    known = {
        key: recipe.felt_vector(recipe.position(key[0]), key[1]) for key in set(zip(position, seating, strict=True))
    }
    return np.array([known[key] for key in zip(position, seating, strict=True)])


def turned(recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...]) -> Floats | None:
    """What turning each pose by one radian about each axis of the device does to the readings (3, v, 3), to first
    order; None for a kind that reads what it feels."""
    if not recipe.converts:
        return None
    felt = _felt_vectors(recipe, position, seating)
    return readings.reading_changes(recipe.sensor, recipe.device, felt, np.cross(np.eye(3)[:, None], felt[None]))


def gold_vectors(recipe: Recipe, reading: tuple[Floats, Floats], seating: tuple[str, ...]) -> tuple[Floats, Floats]:
    """The stimulus (v, 3) in the device's frame as a gold reference measured it, and its covariance (v, 3, 3).

    reading: mean (v, 3) and covariance (v, 3, 3) of the gold sensor, which sits in the nest's frame: its own
    calibration is undone, then the seating turns it into the device's frame.
    """
    gold = gold_of(recipe)
    mean, cov = reading
    inverse = np.linalg.inv(np.array(gold.matrix))
    back = np.array([recipe.seating(s).T for s in seating]) @ inverse
    true = np.einsum("vij,vj->vi", back, mean - np.array(gold.offset))
    return true, back @ cov @ back.transpose(0, 2, 1)


def gold_of(recipe: Recipe) -> GoldReference:
    """The gold reference of a recipe that has one; RecipeError otherwise."""
    if recipe.reference.gold is None:
        raise RecipeError("reference-gold-missing")
    return recipe.reference.gold


def check_due(recipe: Recipe, today: str) -> None:
    """ReferenceOverdue when a reference that the recipe names is past its due date; `today` is ISO 8601."""
    for own in recipe.reference.certificates:
        if own.due < today[:10]:
            raise ReferenceOverdue("reference-overdue", item=own.item, number=own.number, due=own.due, today=today[:10])
    gold = recipe.reference.gold
    if recipe.reference.source == "gold" and gold is not None and gold.due < today[:10]:
        raise ReferenceOverdue("gold-overdue", serial=gold.serial, due=gold.due, today=today[:10])


def check_gravity(recipe: Recipe) -> None:
    """RecipeError where the size of gravity is stated twice (the site or the gravimeter alone would count), or is none
    of the Earth's surface."""
    reference = recipe.reference
    if reference.source != "gravity":
        return
    measured = "site" if reference.site else "gravimeter" if reference.gravimeter else ""
    for other in ("magnitude", "magnitude_std"):
        if measured and getattr(reference, other) is not None:
            raise RecipeError("gravity-stated-twice", recipe=recipe.name, measured=measured, other=other)
    least, most = (limit / gravity.STANDARD for limit in gravity.SURFACE)
    if reference.magnitude is not None and not least <= reference.magnitude <= most:
        raise RecipeError(
            "gravity-not-of-earth", recipe=recipe.name, magnitude=reference.magnitude, low=least, high=most
        )


def direction_errors(
    recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...], true: Floats, angles_deg: Mapping[str, float]
) -> dict[str, Floats]:
    """Patterns (3, v, 3) of errors of the truth (v, 3) from turns that all visits share, by name of the budget line.

    angles_deg: one standard deviation about each axis: `nest` turns about the nest's axes, `base` and `field` about the
    station's. A turn ω of the nest moves the stimulus n in its frame by n × ω, one of the station that of the station.
    """
    seat = np.array([recipe.seating(s) for s in seating])
    if recipe.converts:
        true = _felt_vectors(recipe, position, seating)
    found = {}
    if angles_deg.get("nest"):
        nest = np.einsum("vij,vj->vi", seat, true)
        moved = np.cross(nest[None], np.eye(3)[:, None])
        found["nest tilt"] = np.deg2rad(angles_deg["nest"]) * np.einsum("vij,kvi->kvj", seat, moved)
    if recipe.reference.source == "rate":
        return found
    pose = np.array([recipe.position(p).matrix() for p in position]) @ seat
    station = np.einsum("vij,vj->vi", pose, true)
    for name, line in (("base", "base tilt"), ("field", "field direction")):
        if angles_deg.get(name):
            moved = np.cross(station[None], np.eye(3)[:, None])
            found[line] = np.deg2rad(angles_deg[name]) * np.einsum("vij,kvi->kvj", pose, moved)
    if recipe.converts:
        return {
            line: readings.reading_changes(recipe.sensor, recipe.device, true, each) for line, each in found.items()
        }
    return found


def truth_errors(
    recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...], true: Floats
) -> Mapping[str, Floats]:
    """What the stimulus may be wrong by: a gold reference's own errors, else those of the sensor kind's source.

    Patterns (k, v, 3) by name of the budget line, one standard deviation each; true (v, 3) in the device's frame.
    """
    if recipe.reference.source == "gold":
        return {"gold reference": gold_errors(recipe, true, seating)}
    return sensor.of(recipe).truth_errors(recipe, position, seating, true)


def stimulus_covariance(recipe: Recipe, position: str, seating: str, true: Floats) -> Floats:
    """Covariance (3, 3) of the truth (3) at one position, from what all visits share: size and directions."""
    at = (position,), (seating,), true[None]
    directions = direction_errors(recipe, *at, assumptions.directions_deg(recipe))
    shared = [pattern[:, 0] for pattern in (*truth_errors(recipe, *at).values(), *directions.values())]
    return np.asarray(sum((p.T @ p for p in shared), np.zeros((3, 3))))


def gold_errors(recipe: Recipe, true: Floats, seating: tuple[str, ...]) -> Floats:
    """Patterns (k, v, 3) of one-standard-deviation errors of the truth (v, 3) that a gold reference shares.

    Three for its offset, three for its gain, three for how its axes sit in the nest.
    """
    gold = gold_of(recipe)
    back = np.array([recipe.seating(s).T for s in seating])
    nest = np.einsum("vji,vj->vi", back, true)
    size = float(np.linalg.norm(true, axis=1).max(initial=0.0))
    offset_std = assumptions.GOLD_RELATIVE * size if gold.offset_std is None else gold.offset_std
    gain_std = assumptions.GOLD_RELATIVE if gold.gain_std is None else gold.gain_std
    seat_deg = assumptions.NEST_DEG if gold.seat_std_deg is None else gold.seat_std_deg
    offset = offset_std * back.transpose(2, 0, 1)
    gain = gain_std * np.einsum("vik,vk->kvi", back, nest)
    moved = np.cross(np.eye(3)[:, None, :], nest[None])
    seat = np.deg2rad(seat_deg) * np.einsum("vij,kvj->kvi", back, moved)
    return np.concatenate([offset, gain, seat])
