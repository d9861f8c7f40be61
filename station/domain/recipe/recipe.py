"""The recipe: frozen pydantic models of `station.recipe/1` (docs/formats.md). Pure: text is read elsewhere."""

from difflib import get_close_matches
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from station import plugins
from station.domain.core.types import Floats
from station.domain.recipe import gravity, readings
from station.domain.recipe.blocks import DeviceSheet, DwellRule, FirmwareGate, Limits, Run, Settle, VerifyBlock
from station.domain.recipe.fields import Name, StrictModel, one_of
from station.domain.recipe.position import Position, Turn
from station.domain.recipe.readings import SENSORS
from station.domain.recipe.reference_block import Reference, Reproducibility, ResidualHistory
from station.errors import InvalidValue

METHODS = "station.domain.methods.calibrate"


class Recipe(StrictModel):
    """A whole recipe. Every way to get one checks it; a recipe that exists can be planned."""

    schema_: Annotated[Literal["station.recipe/1"], Field(alias="schema")]
    name: Name
    version: Annotated[int, Field(ge=1)]
    sensor: Annotated[str, one_of(lambda: plugins.names(SENSORS))]
    unit: Annotated[str, one_of(readings.known_units)]
    reference: Reference
    positions: tuple[Position, ...] = ()
    seatings: dict[Name, Turn] = Field(default_factory=dict)
    runs: Annotated[tuple[Run, ...], Field(min_length=1)] = (Run(),)
    device: DeviceSheet = DeviceSheet()
    reproducibility: Reproducibility | None = None
    # What is not stated leaves the hash of a recipe as it was.
    residuals: ResidualHistory | None = Field(default=None, exclude_if=lambda v: v is None)
    settle: Settle = Settle()
    dwell: DwellRule = DwellRule(time_s=1.0)
    visit_repeats: Annotated[int, Field(ge=0, le=5)] = 1
    method: Annotated[str, one_of(lambda: plugins.names(METHODS))] = "n-point"
    model: Literal["offset-gain", "matrix"] = "matrix"
    product: Name | None = None
    firmware: FirmwareGate | None = None
    serial_pattern: str | None = None
    check_digit: Literal["none", "mod10", "mod43"] = "none"
    limits: Limits = Limits()
    verify: VerifyBlock = VerifyBlock()

    @model_validator(mode="after")
    def _hangs_together(self) -> Self:
        _check_unit(self)
        _check_sheet(self)
        _check_names(self)
        _check_poses(self)
        _check_length(self)
        return self

    @property
    def pose_known(self) -> bool:
        """Whether positions say where the stimulus points."""
        return self.reference.pose == "known"

    def seating(self, name: str) -> Floats:
        """Device → nest rotation of a seating."""
        return np.eye(3) if name == "home" and name not in self.seatings else self.seatings[name].matrix()

    def base(self, run: int) -> Floats:
        """Rig → station rotation of a run: how the whole rig is turned on its floor."""
        return Turn(axis=(0, 0, 1), angle_deg=self.runs[run % len(self.runs)].base_turn_deg).matrix()

    @property
    def turns_base(self) -> bool:
        """Whether any run wants the rig turned on its floor."""
        return any(run.base_turn_deg for run in self.runs)

    @property
    def filters_off(self) -> bool:
        """Whether any run wants the units' own filter off."""
        return any(run.filter == "off" for run in self.runs)

    @property
    def feels_gravity_alone(self) -> bool:
        """Whether the stimulus stays what it is when the whole rig is turned about the vertical."""
        return self.reference.source in ("gravity", "gold") and not self.feels_rotation

    def position(self, name: str) -> Position:
        """The position of that name, those of `verify` included; KeyError when there is none."""
        return {p.name: p for p in (*self.verify.positions, *self.positions)}[name]

    def stimulus(self, position: Position) -> Floats:
        """True vector (3) in the station's frame, in the recipe's unit; of a rate: in the nest's frame."""
        if self.reference.source == "rate" or position.rate is not None:
            rate = np.array(position.rate or (0.0, 0.0, 0.0), float)
            return rate + self.earth_rate(position)
        if self.reference.vector is not None:
            return np.array(self.reference.vector, float)
        return np.array([0.0, 0.0, self.reference.strength()])

    @property
    def _sensor_kind(self) -> Any:
        return plugins.load(SENSORS, self.sensor)

    def earth_rate(self, position: Position) -> Floats:
        """The Earth's turning (3) in the nest's frame, deg/s, as far as the site tells it.

        While the nest turns, what lies across its axis goes round and averages out over whole turns.
        """
        site = self.reference.site
        if site is None or not self.feels_rotation:
            return np.zeros(3)
        earth = position.matrix().T @ gravity.earth_rate(site.latitude_deg, site.heading_deg)
        axis = np.array(position.rate or (0.0, 0.0, 0.0), float)
        speed = float(np.linalg.norm(axis))
        return np.asarray(earth if speed == 0 else axis * (axis @ earth) / speed**2)

    @property
    def feels_rotation(self) -> bool:
        """Whether the sensor measures turning, so that what it shows of gravity is an error."""
        return bool(self._sensor_kind.feels_earth_rate)

    @property
    def axes(self) -> int:
        """How many readings the device has; the others are 0."""
        return readings.axis_count(self.sensor, self.device)

    @property
    def converts(self) -> bool:
        """Whether readings are something else than components of what is felt, such as angles."""
        return readings.converting_kind(self.sensor) is not None

    def perfect_reading(self, felt: Floats) -> Floats:
        """What a perfect device reads (…, 3) of what it feels (…, 3) in its own frame."""
        return readings.perfect(self.sensor, self.device, felt)

    def true_vector(self, position: Position, seating: str = "home") -> Floats:
        """What a perfect device reads (3) there: of most kinds what it feels."""
        return self.perfect_reading(self.felt_vector(position, seating))

    def felt_vector(self, position: Position, seating: str = "home") -> Floats:
        """Stimulus (3) in the device's frame: Rᵀ · stimulus, R = R_position · R_seating."""
        if not self.pose_known:
            return np.full(3, np.nan)
        if self.reference.source == "rate":
            return np.asarray(self.seating(seating).T @ self.stimulus(position))
        R = position.matrix() @ self.seating(seating)
        return np.asarray(R.T @ self.stimulus(position))


#: Readings of one visit: five and a half hours at 100 Hz. More is a slip of the pen, and memory for it is not there.
MOST_READINGS = 2_000_000


def _check_length(recipe: Recipe) -> None:
    lasts_s = recipe.settle.time_s + recipe.dwell.longest_s
    if lasts_s * recipe.device.rate_hz > MOST_READINGS:
        raise InvalidValue("visit-too-long", lasts_s=lasts_s, limit_s=MOST_READINGS / recipe.device.rate_hz)


def _check_unit(recipe: Recipe) -> None:
    kind: Any = plugins.load(SENSORS, recipe.sensor)
    if recipe.unit != kind.unit:
        raise InvalidValue("unit-not-of-sensor", unit=recipe.unit, sensor=recipe.sensor, right=kind.unit)
    if recipe.reference.source not in kind.sources:
        source = recipe.reference.source
        raise InvalidValue("source-not-of-sensor", source=source, sensor=recipe.sensor, allowed=kind.sources)


def _check_sheet(recipe: Recipe) -> None:
    """What the kind leaves open must be one of its choices; what it does not leave open must not be stated."""
    kind = readings.converting_kind(recipe.sensor)
    choices: dict[str, tuple[str | int | None, tuple[str | int, ...]]] = {
        "device.axes": (recipe.device.axes, () if kind is None else kind.axes),
        "device.convention": (recipe.device.convention, () if kind is None else kind.conventions),
        "method": (None if kind is None else recipe.method, () if kind is None else kind.methods),
    }
    for key, (given, allowed) in choices.items():
        if given is not None and given not in allowed:
            id_ = "key-not-of-sensor" if allowed else "key-settled-by-sensor"
            raise InvalidValue(id_, key=key, given=given, sensor=recipe.sensor, allowed=allowed)


def _check_names(recipe: Recipe) -> None:
    names: set[str] = set()
    for position in recipe.positions:
        if position.name in names:
            raise InvalidValue("position-listed-twice", position=position.name)
        names.add(position.name)
    for run in recipe.runs:
        if run.seating != "home" and run.seating not in recipe.seatings:
            raise InvalidValue("seating-unknown", seating=run.seating, known=("home", *recipe.seatings))
        for end in (run.first, run.last):
            if end is not None and end not in names:
                nearest = get_close_matches(end, [*names, end], 2, 0)[-1]
                raise InvalidValue("run-end-unknown", position=end, nearest=nearest)


def _check_poses(recipe: Recipe) -> None:
    if recipe.turns_base and not recipe.feels_gravity_alone:
        raise InvalidValue("base-turn-not-gravity", source=recipe.reference.source)
    if not recipe.pose_known:
        if recipe.method != "norm":
            raise InvalidValue("pose-unknown-needs-norm")
        return
    if not recipe.positions:
        raise InvalidValue("positions-missing")
    for position in (*recipe.positions, *recipe.verify.positions):
        if recipe.reference.source == "rate":
            if position.rate is None:
                raise InvalidValue("position-without-rate", position=position.name)
        elif not position.oriented:
            raise InvalidValue("position-without-orientation", position=position.name)
