"""The map of a rig (`rigs/*.yaml`, schema station.rig/1): its drives, what a count is, and where it may not go."""

from functools import cached_property
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from station.domain.core.types import Floats
from station.domain.recipe.fields import Finite, Name, NotNegative, Positive, StrictModel, Vector
from station.domain.rig import kinematics
from station.domain.rig.paths import Space, Zone
from station.errors import InvalidValue

Node = Annotated[int, Field(ge=1, le=127)]
Word = Annotated[int, Field(ge=0, le=0xFFFF_FFFF)]
AngleRange = tuple[Finite, Finite]
#: Axes closer to parallel than this cannot bring every direction up, degrees.
PARALLEL_DEG = 10.0
_INT32 = 2**31 - 1


class DriveType(StrictModel):
    """What the drives must answer at 0x1000 (lower 16 bits) and 0x1018; revision 0: any."""

    device_profile: Annotated[int, Field(ge=0, le=0xFFFF)] = 402
    vendor: Word
    product: Word
    revision: Word = 0


class Homing(StrictModel):
    """The drive's own homing: method (0x6098), speeds (0x6099), and the angle at which it ends (0x607C)."""

    method: Annotated[int, Field(ge=-128, le=127)]
    fast_deg_s: Positive
    slow_deg_s: Positive
    acceleration_deg_s2: Positive
    home_deg: Finite = 0.0
    timeout_s: Positive = 60.0

    @model_validator(mode="after")
    def _check_method(self) -> Self:
        if self.method in (0, 35, 37):
            raise InvalidValue("homing-method-moves-nothing", below=("method",), method=self.method)
        return self


class SafeTorqueOff(StrictModel):
    """Where a drive reports that its power stage is cut: bits of an object of its maker, and their value when it may
    turn."""

    index: Annotated[int, Field(ge=0x2000, le=0x5FFF)]
    sub: Annotated[int, Field(ge=0, le=255)] = 0
    mask: Annotated[int, Field(ge=1, le=0xFFFF_FFFF)]
    clear: Word = 0


class Axis(StrictModel):
    """One axis. node: node id of its drive; axis: 0, 1, … among those of the node; turns: its direction in the station
    while all angles are zero; counts_per_deg: of the encoder, negative where it counts backwards; zero_counts: at 0°.
    """

    name: Name
    node: Node
    axis: Annotated[int, Field(ge=0, le=7)] = 0
    turns: Vector
    counts_per_deg: Finite
    zero_counts: Annotated[int, Field(ge=-_INT32, le=_INT32)] = 0
    limits_deg: AngleRange
    speed_deg_s: Positive = 90.0
    acceleration_deg_s2: Positive = 180.0
    stop_deg_s2: Positive = 720.0
    window_deg: Positive = 0.02
    window_s: Annotated[float, Field(ge=0.001, le=5, allow_inf_nan=False)] = 0.02
    following_deg: Positive = 2.0
    following_s: Annotated[float, Field(ge=0.001, le=5, allow_inf_nan=False)] = 0.05
    homing: Literal["absolute"] | Homing = "absolute"
    hold: Literal["servo", "brake"] = "servo"
    brake_s: NotNegative = 0.1
    safe_torque_off: SafeTorqueOff | None = None
    without: frozenset[int] = frozenset()

    @field_validator("without", mode="before")
    @classmethod
    def _listed(cls, value: object) -> object:
        return frozenset(value) if isinstance(value, (list, tuple)) else value

    @model_validator(mode="after")
    def _check(self) -> Self:
        low, high = self.limits_deg
        if not low < high:
            raise InvalidValue("axis-limits-inside-out", below=("limits_deg",), axis=self.name, low=low, high=high)
        if not 1e-6 < abs(self.counts_per_deg) < 1e8:
            raise InvalidValue("axis-counts", below=("counts_per_deg",), axis=self.name, counts=self.counts_per_deg)
        if not 1e-9 < float(np.linalg.norm(self.turns)) < 1e9:
            raise InvalidValue("axis-without-length", below=("turns",))
        for angle in self.limits_deg:
            if abs(self.zero_counts + angle * self.counts_per_deg) > _INT32:
                raise InvalidValue("axis-counts-beyond", below=("limits_deg",), axis=self.name, angle_deg=angle)
        if abs(self.counts_per_deg) * self.window_deg < 1:
            raise InvalidValue(
                "axis-window-below-count", below=("window_deg",), axis=self.name, window_deg=self.window_deg
            )
        if isinstance(self.homing, Homing) and not low <= self.homing.home_deg <= high:
            raise InvalidValue(
                "axis-home-outside", below=("homing", "home_deg"), axis=self.name, home_deg=self.homing.home_deg
            )
        forbidden = self.without - WAIVABLE
        if forbidden:
            raise InvalidValue(
                "axis-object-not-waivable",
                below=("without",),
                axis=self.name,
                objects=[f"0x{i:04X}" for i in forbidden],
            )
        return self

    @property
    def direction(self) -> Floats:
        """Unit vector (3) about which it turns."""
        return np.asarray(np.array(self.turns) / np.linalg.norm(self.turns))

    def counts(self, angle_deg: float) -> int:
        """Encoder counts of an angle, rounded."""
        return round(self.zero_counts + angle_deg * self.counts_per_deg)

    def angle_deg(self, counts: float) -> float:
        """Angle of encoder counts."""
        return float((counts - self.zero_counts) / self.counts_per_deg)

    def rate(self, deg: float) -> int:
        """Counts of a speed, an acceleration or a window, at least 1."""
        return max(1, round(abs(self.counts_per_deg) * deg))


#: Objects that a drive may lack; without the others nobody could stop it in time.
WAIVABLE = frozenset({0x1008, 0x605D, 0x605E, 0x6066, 0x6067, 0x6068})


class ForbiddenZone(StrictModel):
    """Angles, degrees, that the rig must never take together: a range for each axis; an axis left out: all of it."""

    name: Name
    ranges: dict[str, AngleRange]


class RigMap(StrictModel):
    """A rig: outer axis first. The drives watch node `station_node`, and stop when it falls silent for watchdog_s."""

    schema_: Annotated[Literal["station.rig/1"], Field(alias="schema")] = "station.rig/1"
    name: Name
    drive: DriveType
    axes: Annotated[tuple[Axis, ...], Field(min_length=1, max_length=2)]
    forbidden: Annotated[tuple[ForbiddenZone, ...], Field(max_length=32)] = ()
    clearance_deg: NotNegative = 1.0
    park_deg: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=2)]
    station_node: Node = 126
    watchdog_s: Annotated[float, Field(ge=0.05, le=0.3, allow_inf_nan=False)] = 0.2
    match: Literal["up", "attitude"] = "up"
    reach_deg: Positive = 0.05

    @model_validator(mode="after")
    def _check_axes(self) -> Self:
        places = [(axis.node, axis.axis) for axis in self.axes]
        names = [axis.name for axis in self.axes]
        if len(set(places)) < len(places) or len(set(names)) < len(names):
            raise InvalidValue("rig-axis-twice", below=("axes",))
        if self.station_node in [axis.node for axis in self.axes]:
            raise InvalidValue("rig-station-node-taken", below=("station_node",), node=self.station_node)
        if len(self.axes) == 2:
            angle = float(np.degrees(np.arccos(np.clip(abs(np.dot(*self.directions)), 0, 1))))
            if angle < PARALLEL_DEG:
                raise InvalidValue("rig-axes-parallel", below=("axes", 1, "turns"), angle_deg=angle)
        for number, zone in enumerate(self.forbidden):
            ranges = ("forbidden", number, "ranges")
            for name, (low, high) in zone.ranges.items():
                if name not in names:
                    raise InvalidValue(
                        "zone-axis-unknown", below=(*ranges, name), zone=zone.name, axis=name, known=names
                    )
                if not low < high:
                    raise InvalidValue(
                        "zone-inside-out", below=(*ranges, name), zone=zone.name, axis=name, low=low, high=high
                    )
            if not zone.ranges:
                raise InvalidValue("zone-empty", below=ranges, zone=zone.name)
        return self

    @model_validator(mode="after")
    def _check_park(self) -> Self:
        if len(self.park_deg) != len(self.axes):
            raise InvalidValue("rig-park-axes", below=("park_deg",), given=len(self.park_deg), axes=len(self.axes))
        for axis, angle in zip(self.axes, self.park_deg, strict=True):
            if not axis.limits_deg[0] <= angle <= axis.limits_deg[1]:
                raise InvalidValue("rig-park-outside", below=("park_deg",), axis=axis.name, angle_deg=angle)
        if (zone := self.space.zone_at(self.park_deg)) is not None:
            raise InvalidValue("rig-park-in-zone", below=("park_deg",), zone=zone.name)
        return self

    @model_validator(mode="after")
    def _check_homing(self) -> Self:
        """While an axis looks for its home, those after it may stand anywhere, those before it are at theirs."""
        for number, axis in enumerate(self.axes):
            if not isinstance(axis.homing, Homing):
                continue
            swept = [_homed(before) if i < number else before.limits_deg for i, before in enumerate(self.axes)]
            low, high = tuple(s[0] for s in swept), tuple(s[1] for s in swept)
            for zone in self.space.zones:
                if zone.meets(low, high):
                    raise InvalidValue(
                        "rig-homing-through-zone", below=("axes", number, "homing"), axis=axis.name, zone=zone.name
                    )
        return self

    @property
    def directions(self) -> tuple[Floats, ...]:
        """Unit vectors (3) of the axes."""
        return tuple(axis.direction for axis in self.axes)

    @property
    def limits(self) -> tuple[AngleRange, ...]:
        """Software limits of the axes, degrees."""
        return tuple(axis.limits_deg for axis in self.axes)

    @cached_property
    def space(self) -> Space:
        """Where the rig may go."""
        whole = (-1e6, 1e6)
        zones = tuple(
            Zone(zone.name, tuple(zone.ranges.get(axis.name, whole) for axis in self.axes)) for zone in self.forbidden
        )
        speeds = tuple(axis.speed_deg_s for axis in self.axes)
        accelerations = tuple(axis.acceleration_deg_s2 for axis in self.axes)
        return Space(self.limits, zones, speeds, accelerations, self.clearance_deg)

    def attitude(self, angles_deg: tuple[float, ...]) -> Floats:
        """Nest → station rotation (3, 3) at these angles."""
        return kinematics.attitude(self.directions, angles_deg)

    def goals(self, nest: Floats) -> list[tuple[float, ...]]:
        """Angles within the limits that bring up what `nest` brings up; in the full attitude where that can be had."""
        poses = [
            pose
            for found in kinematics.poses(self.directions, nest, self.reach_deg)
            for pose in kinematics.within(found, self.limits)
        ]
        whole = [pose.angles_deg for pose in poses if pose.yaw_deg <= max(kinematics.SAME_DEG, self.reach_deg)]
        return whole or ([] if self.match == "attitude" else [pose.angles_deg for pose in poses])


def _homed(axis: Axis) -> AngleRange:
    """Where an axis that was homed stands; one with an absolute encoder may stand anywhere."""
    return (axis.homing.home_deg,) * 2 if isinstance(axis.homing, Homing) else axis.limits_deg
