"""Positions and seatings: how a recipe says an orientation."""

from functools import lru_cache
from typing import Literal, Self

import numpy as np
from pydantic import model_validator

from station.domain.core import rotation
from station.domain.core.types import Floats
from station.domain.recipe.fields import Finite, Name, StrictModel, Vector
from station.errors import InvalidValue


class Turn(StrictModel):
    """One rotation about an axis of the station, right-handed."""

    axis: Vector
    angle_deg: Finite

    @model_validator(mode="after")
    def _axis_has_length(self) -> Self:
        if not 1e-9 < float(np.linalg.norm(self.axis)) < 1e9:
            raise InvalidValue("axis-without-length")
        return self

    @property
    def axis_name(self) -> str:
        """x, -z, or the vector itself where it is no axis of the station."""
        parts = [(name, value) for name, value in zip("xyz", self.axis, strict=True) if value]
        if len(parts) == 1:
            return parts[0][0] if parts[0][1] > 0 else f"-{parts[0][0]}"
        return f"[{', '.join(f'{value:g}' for value in self.axis)}]"

    def matrix(self) -> Floats:
        """The rotation as a matrix, not to be written to."""
        return _rotation_about(self.axis, self.angle_deg)


@lru_cache(maxsize=1024)
def _rotation_about(axis: Vector, angle_deg: float) -> Floats:
    """A rotation, cached: a recipe's few turns are needed at every visit."""
    R = rotation.about(np.array(axis), angle_deg)
    R.flags.writeable = False
    return R


UP = {f"{s}{a}": (1.0 if s == "+" else -1.0) * np.eye(3)[i] for s in "+-" for i, a in enumerate("xyz")}


class Position(StrictModel):
    """One orientation of the nest, given in one of three ways, or none where the pose is unknown."""

    name: Name
    quaternion: tuple[Finite, Finite, Finite, Finite] | None = None
    up: Literal["+x", "-x", "+y", "-y", "+z", "-z"] | None = None
    rotate: tuple[Turn, ...] | None = None
    rate: Vector | None = None

    @model_validator(mode="after")
    def _check_orientation(self) -> Self:
        given = [k for k in ("quaternion", "up", "rotate") if getattr(self, k) is not None]
        if len(given) > 1:
            raise InvalidValue("orientation-given-twice", keys=tuple(given))
        if self.quaternion is not None and abs(float(np.linalg.norm(self.quaternion)) - 1) > 1e-3:
            raise InvalidValue("quaternion-not-unit", length=float(np.linalg.norm(self.quaternion)))
        return self

    @property
    def oriented(self) -> bool:
        """Whether an orientation is given."""
        return any(v is not None for v in (self.quaternion, self.up, self.rotate))

    def matrix(self) -> Floats:
        """Nest → station rotation, not to be written to; the identity where none is given."""
        turns = tuple((turn.axis, turn.angle_deg) for turn in self.rotate or ())
        return _orientation(self.quaternion, self.up, turns)


@lru_cache(maxsize=1024)
def _orientation(
    quaternion: tuple[float, float, float, float] | None, up: str | None, turns: tuple[tuple[Vector, float], ...]
) -> Floats:
    """An orientation, cached: those of a recipe are needed at every visit."""
    if quaternion is not None:
        R = rotation.from_quaternion(np.array(quaternion))
    elif up is not None:
        R = rotation.shortest(UP[up], UP["+z"])
    else:
        R = np.eye(3)
        for axis, angle_deg in turns:
            R = _rotation_about(axis, angle_deg) @ R
    R.flags.writeable = False
    return R
