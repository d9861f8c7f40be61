"""The recipe: frozen pydantic models of `station.recipe/1` (docs/formats.md). Pure: text is read elsewhere."""

from collections.abc import Callable, Sequence
from difflib import get_close_matches
from functools import lru_cache
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from station import plugins
from station.domain.core import rotation
from station.domain.core.types import Floats
from station.domain.recipe import gravity
from station.errors import InvalidValue

Finite = Annotated[float, Field(allow_inf_nan=False)]
Vector = tuple[Finite, Finite, Finite]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[\w.+\-/ ]+$")]


class StrictModel(BaseModel):
    """Base of every block: frozen, and an unknown key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)


class Turn(StrictModel):
    """One rotation about an axis of the station, right-handed."""

    axis: Vector
    angle_deg: Finite

    @model_validator(mode="after")
    def _axis_has_length(self) -> Self:
        if not 1e-9 < float(np.linalg.norm(self.axis)) < 1e9:
            raise InvalidValue("axis-without-length")
        return self

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
        """Nest → station rotation; the identity where none is given."""
        if self.quaternion is not None:
            return rotation.from_quaternion(np.array(self.quaternion))
        if self.up is not None:
            return rotation.shortest(UP[self.up], UP["+z"])
        R = np.eye(3)
        for turn in self.rotate or ():
            R = turn.matrix() @ R
        return R


class Site(StrictModel):
    """Where the station stands, for local gravity and the Earth's turning.

    heading_deg: azimuth of the station's x axis, clockwise from north; wanted by sensors that feel the Earth's turning.
    """

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    altitude_m: Annotated[float, Field(ge=-500, le=9000)] = 0.0
    anomaly_std_ppm: NotNegative = 30.0
    heading_deg: Finite | None = None


class Gravimeter(StrictModel):
    """Local gravity as a gravimeter measured it, with its standard uncertainty, both in m/s²."""

    value_m_s2: Annotated[float, Field(ge=9.7, le=9.9)]
    std_m_s2: NotNegative


class Reproducibility(StrictModel):
    """What a coefficient differs by when the same unit is measured again on other days, in other nests, after
    reseating (Type A): standard deviations, offset in the recipe's unit; dof: degrees of freedom they come from."""

    offset: NotNegative = 0.0
    gain: NotNegative = 0.0
    cross_axis: NotNegative = 0.0
    dof: Annotated[float, Field(ge=1)]


class ReferenceCertificate(StrictModel):
    """Traceability of one reference: what it is, number of its certificate, due date (ISO), who issued it."""

    item: Name
    number: Annotated[str, Field(min_length=1)]
    due: Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\d$")]
    issuer: str = ""


class GoldReference(StrictModel):
    """A gold reference sensor in the same orientation, with its own calibration, uncertainty and due date.

    offset, matrix: measured = matrix · true + offset, in the recipe's unit; offset_std, gain_std: standard
    uncertainty per axis; seat_std_deg: how well its axes agree with the nest's; node: its node id on the bus;
    certificate: number of its certificate.
    """

    serial: Name
    offset: Vector = (0.0, 0.0, 0.0)
    matrix: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    offset_std: NotNegative | None = None
    gain_std: NotNegative | None = None
    seat_std_deg: NotNegative | None = None
    due: Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\d$")]
    certificate: str = ""
    node: Annotated[int, Field(ge=1, le=127)] | None = None

    @model_validator(mode="after")
    def _check_invertible(self) -> Self:
        if not np.linalg.det(self.matrix) > 1e-6:
            raise InvalidValue("gold-matrix-singular")
        return self


class Reference(StrictModel):
    """Where the true stimulus comes from. magnitude and vector in the recipe's unit.

    Standard uncertainties: magnitude_std in that unit; pose_std_deg of each pose by itself, about each axis;
    nest_std_deg: how the nest sits on the fixture, base_std_deg: how the fixture stands, field_std_deg: direction of
    a field, each the same for all poses; thermometer_std_degC. One that is not stated takes the default of
    station.domain.recipe.assumptions, with its source. certificates: traceability of fixture, thermometer, field, …
    """

    source: Literal["gravity", "field", "rate", "gold"]
    magnitude: Positive | None = None
    magnitude_std: NotNegative | None = None
    vector: Vector | None = None
    site: Site | None = None
    gravimeter: Gravimeter | None = None
    pose: Literal["known", "unknown"] = "known"
    pose_std_deg: NotNegative | None = None
    nest_std_deg: NotNegative | None = None
    base_std_deg: NotNegative | None = None
    field_std_deg: NotNegative | None = None
    thermometer_std_degC: NotNegative | None = None
    gold: GoldReference | None = None
    certificates: tuple[ReferenceCertificate, ...] = ()

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.source == "gold" and self.gold is None:
            raise InvalidValue("source-gold-incomplete")
        if self.source == "field" and self.vector is None and self.magnitude is None:
            raise InvalidValue("source-field-incomplete")
        if self.site is not None and self.source == "field":
            raise InvalidValue("site-with-field")
        if self.gravimeter is not None and (self.source != "gravity" or self.site is not None):
            raise InvalidValue("gravimeter-elsewhere")
        return self

    def strength(self) -> float:
        """Magnitude of the true stimulus in the recipe's unit (1 for a rate, whose positions carry their own)."""
        if self.site is not None and self.source != "rate":
            return gravity.normal_gravity(self.site.latitude_deg, self.site.altitude_m) / gravity.STANDARD
        if self.gravimeter is not None:
            return self.gravimeter.value_m_s2 / gravity.STANDARD
        if self.magnitude is not None:
            return self.magnitude
        return float(np.linalg.norm(self.vector)) if self.vector is not None else 1.0

    def relative_std(self) -> float:
        """Standard uncertainty of the magnitude, relative: local anomalies at a site, else as stated (0 if not)."""
        if self.site is not None and self.source != "rate":
            return self.site.anomaly_std_ppm * 1e-6
        if self.gravimeter is not None:
            return self.gravimeter.std_m_s2 / self.gravimeter.value_m_s2
        return (self.magnitude_std or 0.0) / self.strength()


class Run(StrictModel):
    """One pass of the unit through the positions. first, last: where the order `fastest` must begin and end."""

    seating: Name = "home"
    order: Literal["listed", "reversed", "shuffled", "fastest"] = "listed"
    first: Name | None = None
    last: Name | None = None
    temperature_offset_degC: Finite = 0.0
    prewarm_s: NotNegative = 0.0
    motors: Annotated[Literal["on", "off"], BeforeValidator(lambda v: {True: "on", False: "off"}.get(v, v))] = "on"

    @model_validator(mode="after")
    def _check_ends(self) -> Self:
        given = [key for key in ("first", "last") if getattr(self, key) is not None]
        if given and self.order != "fastest":
            raise InvalidValue("run-end-not-free", key=given[0], order=self.order)
        if len(given) == 2 and self.first == self.last:
            raise InvalidValue("run-ends-same", position=self.first)
        return self


class DeviceSheet(StrictModel):
    """What the device's data sheet promises; the ideal that faults are measured against.

    lsb, full_scale and noise_density in the recipe's unit (noise per √Hz). Typical sizes (one standard deviation)
    for the uncertainty budget: offset_tempco in unit/°C, gain_tempco in 1/°C, g_sensitivity in unit/g; gain_std and
    cross_std of what a method takes for granted; turn_on_std of the offset from one run to the next, in the unit.
    rounding: what its converter does with the rest of a step.
    """

    rate_hz: Positive = 100.0
    clock_tolerance_ppm: NotNegative = 200.0
    lsb: NotNegative = 0.0
    full_scale: Positive | None = None
    noise_density: NotNegative | None = None
    counter_bits: Annotated[int, Field(ge=1, le=32)] = 8
    offset_tempco: NotNegative = 0.0
    gain_tempco: NotNegative = 0.0
    g_sensitivity: NotNegative = 0.0
    gain_std: NotNegative | None = None
    cross_std: NotNegative | None = None
    turn_on_std: NotNegative | None = None
    rounding: Literal["nearest", "truncating", "unknown"] = "unknown"


class Settle(StrictModel):
    """How long after a move readings are left out."""

    time_s: NotNegative = 0.3


class DwellRule(StrictModel):
    """How long a stop is measured: a fixed time, or until the mean is good enough."""

    time_s: Positive | None = None
    until_std: Positive | None = None
    min_s: Positive = 0.2
    max_s: Positive = 5.0

    @model_validator(mode="after")
    def _check_time_or_std(self) -> Self:
        if (self.time_s is None) == (self.until_std is None):
            raise InvalidValue("dwell-without-end")
        if self.min_s > self.max_s:
            raise InvalidValue("dwell-bounds-swapped", min_s=self.min_s, max_s=self.max_s)
        return self

    @property
    def longest_s(self) -> float:
        """The dwell that a plan must reckon with."""
        return self.time_s if self.time_s is not None else self.max_s


class Process(StrictModel):
    """What the process makes: mean and standard deviation of the deviation from nominal, by kind of coefficient."""

    offset: tuple[Finite, Positive] | None = None
    gain: tuple[Finite, Positive] | None = None
    cross_axis: tuple[Finite, Positive] | None = None


class Limits(StrictModel):
    """Acceptance limits and the decision rule (JCGM 106, ILAC-G8). Half-widths about nominal unless stated.

    offset, residual, consistency, noise: the recipe's unit; gain, cross_axis: 1; tilt_deg: degrees.
    rule: simple (no guard band) | guard-band (w = U for 95 %) | false-accept (w so that the probability of a
    false accept at the limit is at most `false_accept`). process: what units are like before they are measured, by
    which risks are computed (JCGM 106); left out: anything, which overstates them.
    """

    rule: Literal["simple", "guard-band", "false-accept"] = "simple"
    false_accept: Annotated[float, Field(gt=0, lt=0.5)] | None = None
    offset: Positive | None = None
    gain: Positive | None = None
    cross_axis: Positive | None = None
    residual: Positive | None = None
    consistency: Positive | None = None
    tilt_deg: Positive | None = None
    noise: Positive | None = None
    temperature_degC: tuple[Finite, Finite] | None = None
    process: Process | None = None

    @model_validator(mode="after")
    def _check_limits(self) -> Self:
        if self.rule == "false-accept" and self.false_accept is None:
            raise InvalidValue("rule-without-false-accept")
        if self.temperature_degC is not None and self.temperature_degC[0] >= self.temperature_degC[1]:
            low, high = self.temperature_degC
            raise InvalidValue("temperature-limits-swapped", low=low, high=high)
        return self


class VerifyBlock(StrictModel):
    """Positions measured again through the device's own corrected output; limit in the recipe's unit."""

    positions: tuple[Position, ...] = ()
    limit: Positive | None = None


SENSORS, METHODS = "station.domain.recipe.sensors", "station.domain.methods.calibrate"


def one_of(known: Callable[[], Sequence[str]]) -> BeforeValidator:
    """Checks that a value is one of the names that exist, plug-ins by their files."""

    def check(value: Any) -> Any:
        names = known()
        if value not in names:
            near = get_close_matches(str(value), names, 1, 0)[0]
            raise InvalidValue("name-unknown", given=str(value), known=tuple(names), nearest=near)
        return value

    return BeforeValidator(check)


def _units() -> list[str]:
    kinds: list[Any] = list(plugins.load_all(SENSORS).values())
    return [kind.unit for kind in kinds]


class Recipe(StrictModel):
    """A whole recipe. Every way to get one checks it; a recipe that exists can be planned."""

    schema_: Annotated[Literal["station.recipe/1"], Field(alias="schema")]
    name: Name
    version: Annotated[int, Field(ge=1)]
    sensor: Annotated[str, one_of(lambda: plugins.names(SENSORS))]
    unit: Annotated[str, one_of(_units)]
    reference: Reference
    positions: tuple[Position, ...] = ()
    seatings: dict[Name, Turn] = {}
    runs: Annotated[tuple[Run, ...], Field(min_length=1)] = (Run(),)
    device: DeviceSheet = DeviceSheet()
    reproducibility: Reproducibility | None = None
    settle: Settle = Settle()
    dwell: DwellRule = DwellRule(time_s=1.0)
    visit_repeats: Annotated[int, Field(ge=0, le=5)] = 1
    method: Annotated[str, one_of(lambda: plugins.names(METHODS))] = "n-point"
    model: Literal["offset-gain", "matrix"] = "matrix"
    product: Name | None = None
    serial_pattern: str | None = None
    check_digit: Literal["none", "mod10", "mod43"] = "none"
    limits: Limits = Limits()
    verify: VerifyBlock = VerifyBlock()

    @model_validator(mode="after")
    def _hangs_together(self) -> Self:
        _check_unit(self)
        _check_names(self)
        _check_poses(self)
        return self

    @property
    def pose_known(self) -> bool:
        """Whether positions say where the stimulus points."""
        return self.reference.pose == "known"

    def seating(self, name: str) -> Floats:
        """Device → nest rotation of a seating."""
        return np.eye(3) if name == "home" and name not in self.seatings else self.seatings[name].matrix()

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
        if site is None or not self._sensor_kind.feels_earth_rate:
            return np.zeros(3)
        earth = position.matrix().T @ gravity.earth_rate(site.latitude_deg, site.heading_deg)
        axis = np.array(position.rate or (0.0, 0.0, 0.0), float)
        speed = float(np.linalg.norm(axis))
        return np.asarray(earth if speed == 0 else axis * (axis @ earth) / speed**2)

    def true_vector(self, position: Position, seating: str = "home") -> Floats:
        """True vector (3) in the device's frame: Rᵀ · stimulus, R = R_position · R_seating."""
        if not self.pose_known:
            return np.full(3, np.nan)
        if self.reference.source == "rate":
            return np.asarray(self.seating(seating).T @ self.stimulus(position))
        R = position.matrix() @ self.seating(seating)
        return np.asarray(R.T @ self.stimulus(position))


def _check_unit(recipe: Recipe) -> None:
    kind: Any = plugins.load(SENSORS, recipe.sensor)
    if recipe.unit != kind.unit:
        raise InvalidValue("unit-not-of-sensor", unit=recipe.unit, sensor=recipe.sensor, right=kind.unit)
    if recipe.reference.source not in kind.sources:
        source = recipe.reference.source
        raise InvalidValue("source-not-of-sensor", source=source, sensor=recipe.sensor, allowed=kind.sources)


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
