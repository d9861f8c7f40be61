"""The planned visits as a perfect sensor with the data sheet's noise and resolution would see them."""

import numpy as np

from station.domain.capture.rest_detection import expected_noise
from station.domain.core.types import Floats, ReducedVisits
from station.domain.noise import resolution
from station.domain.planning import design
from station.domain.recipe import directions, plan
from station.domain.recipe.recipe import Recipe


def names(recipe: Recipe) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Position and seating of every planned visit of all runs, hand-held ones included."""
    named = [(name, run.seating) for i, run in enumerate(recipe.runs) for name in plan.names(recipe, i)]
    return tuple(name for name, _ in named), tuple(seating for _, seating in named)


def truths(recipe: Recipe) -> Floats:
    """True stimulus (v, 3) of every planned visit; hand-held visits are taken to be spread evenly."""
    if recipe.pose_known:
        return design.planned_truths(recipe)[2]
    return directions.spread(len(names(recipe)[0])) * recipe.reference.strength()


def beyond_range(recipe: Recipe) -> tuple[str, ...]:
    """Positions where the stimulus alone is beyond `device.full_scale`, so that every unit clips there."""
    full = recipe.device.full_scale
    if full is None:
        return ()
    too_much = np.abs(truths(recipe)).max(axis=1) > full * (1 + 1e-9)
    return tuple(dict.fromkeys(np.array(names(recipe)[0], object)[too_much]))


def nominal_visits(recipe: Recipe, dwell_s: Floats) -> ReducedVisits:
    """The visits of all runs, dwelt at for dwell_s (v)."""
    position, seating = names(recipe)
    true, noise = truths(recipe), expected_noise(recipe)
    v = len(position)
    count = np.maximum(np.rint(dwell_s * recipe.device.rate_hz), 1).astype(np.int64)
    rounding = float(resolution.rounding_variance(np.array(recipe.device.lsb), np.array(noise)))
    return ReducedVisits(
        position=position,
        seating=seating,
        run=np.zeros(v, np.int32),
        visit=np.arange(v, dtype=np.int32),
        mean=true,
        cov=(noise**2 / count + rounding)[:, None, None] * np.eye(3),
        quantisation=np.full((v, 3), rounding),
        dof=np.full((v, 3), 1e6),
        true=true,
        std=np.full((v, 3), noise),
        count=count,
        effective=count.astype(float),
        time_s=np.cumsum(dwell_s + recipe.settle.time_s) - dwell_s,
        temperature_degC=_temperatures(recipe),
    )


def _temperatures(recipe: Recipe) -> Floats:
    """Planned differences between the runs, about 20 °C."""
    return np.concatenate(
        [np.full(len(plan.names(recipe, i)), 20.0 + run.temperature_offset_degC) for i, run in enumerate(recipe.runs)]
    )
