"""Gyroscope: at rest it still feels the Earth turn, and gravity pulls at its mass (g-sensitivity)."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from station.domain.core.types import Floats
from station.domain.recipe import assumptions
from station.domain.recipe.recipe import Recipe


class Gyroscope:
    """Rate in deg/s. Truth: the speed of a rate table or step motor plus the Earth's, or a gold sensor.

    Where positions differ in orientation, n-point fits the g-sensitivity beside the coefficients; otherwise the
    data sheet's device.g_sensitivity stands in the budget.
    """

    unit: ClassVar[str] = "deg/s"
    quantity: ClassVar[str] = "rate"
    sources: ClassVar[tuple[str, ...]] = ("rate", "gold")
    #: ICM-20948, L3GD20H: 0.04 to 0.05 deg/s/degC; 4 % over 125 degC.
    usual_tempcos: ClassVar[tuple[float, float]] = (0.05, 3e-4)
    #: MTi-10, MTi-100: within 0.5 and 0.2 deg/s from one power-on to another.
    usual_turn_on: ClassVar[float] = 0.2
    feels_earth_rate: ClassVar[bool] = True
    large_offset: ClassVar[bool] = False

    def truth_errors(
        self, recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...], true: Floats
    ) -> Mapping[str, Floats]:
        """The table's speed, the Earth's turning where site or heading is not said, and the pull of gravity."""
        return {
            "rate": _table_speed(recipe, position, seating),
            "Earth rate": self._earth(recipe, position, seating),
            "g-sensitivity": self._gravity(recipe, position, seating),
        }

    def nuisance(self, recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...]) -> Floats:
        """Gravity (v, 3) in the device's frame, in g, where it differs."""
        felt = self._gravity_felt(recipe, position, seating)
        return felt if np.ptp(felt, axis=0).max() > 1e-6 else np.zeros((len(position), 0))

    def _earth(self, recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...]) -> Floats:
        """What is not known of the Earth's turning: level parts without a heading, all of it without a site."""
        unknown = assumptions.unknown_earth_rate(recipe)
        if not unknown.any():
            return np.zeros((0, len(position), 3))
        parts = np.diag(unknown)
        return np.array(
            [[self._felt(recipe, p, s, part) for p, s in zip(position, seating, strict=True)] for part in parts]
        )

    @staticmethod
    def _felt(recipe: Recipe, position: str, seating: str, station: Floats) -> Floats:
        """A steady vector of the station in the device's frame; across a turning axis it averages out."""
        place = recipe.position(position)
        nest = place.matrix().T @ station
        axis = np.array(place.rate or (0.0, 0.0, 0.0))
        if axis.any():
            nest = axis * (axis @ nest) / (axis @ axis)
        return np.asarray(recipe.seating(seating).T @ nest)

    def _gravity_felt(self, recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...]) -> Floats:
        """Gravity (v, 3) in the device's frame, in g: about a level spindle it goes round and averages out."""
        up = np.array([0.0, 0.0, 1.0])
        return np.array([self._felt(recipe, p, s, up) for p, s in zip(position, seating, strict=True)])

    def _gravity(self, recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...]) -> Floats:
        """Each axis may feel gravity along each axis: nine patterns."""
        pull = assumptions.g_sensitivity(recipe) * self._gravity_felt(recipe, position, seating)
        return np.asarray(np.einsum("vj,ik->ijvk", pull, np.eye(3)).reshape(9, len(position), 3))


def _table_speed(recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...]) -> Floats:
    """One share of the table's speed, stated at its fastest; a table that stands still has no wrong speed."""
    places = [recipe.position(p) for p in position]
    rates = [recipe.seating(s).T @ np.array(p.rate or (0.0,) * 3) for p, s in zip(places, seating, strict=True)]
    fastest = max((float(np.linalg.norm(p.rate or (0.0,) * 3)) for p in (*recipe.positions, *places)), default=0.0)
    stated = recipe.reference.magnitude_std
    share = assumptions.RATE_RELATIVE if stated is None or not fastest else stated / fastest
    return share * np.array(rates)[None]
