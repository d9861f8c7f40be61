"""Recipes for the tests of the forward simulation: three axes in steps of 45 degrees, three runs."""

from collections.abc import Sequence
from typing import Any

from station.domain.recipe.recipe import Recipe

THREE_RUNS = [
    {},
    {"order": "reversed", "temperature_offset_degC": 10},
    {"seating": "turned", "prewarm_s": 600, "motors": "off", "order": "shuffled"},
]


def tilt(third: Sequence[int] = (0, 0, 1), **changes: Any) -> Recipe:
    """24 tilts of an accelerometer about x, y and a third axis; keys of the recipe may be changed."""
    turns = [(axis, 45 * i) for axis in ([1, 0, 0], [0, 1, 0], [*third]) for i in range(8)]
    return Recipe.model_validate(
        {
            "schema": "station.recipe/1",
            "name": "tilt-24",
            "version": 1,
            "sensor": "accelerometer",
            "unit": "g",
            "reference": {"source": "gravity", "magnitude": 1.0},
            "positions": [
                {"name": f"p{i}", "rotate": [{"axis": axis, "angle_deg": angle}]}
                for i, (axis, angle) in enumerate(turns)
            ],
            "seatings": {"turned": {"axis": [0, 0, 1], "angle_deg": 180}},
            "settle": {"time_s": 0.0},
            "dwell": {"time_s": 0.2},
            **changes,
        }
    )
