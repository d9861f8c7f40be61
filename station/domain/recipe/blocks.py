"""The other blocks of a recipe: runs, data sheet, settling, dwell, limits, verification."""

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from station.domain.recipe.fields import Finite, Name, NotNegative, Positive, StrictModel, TemperatureStep
from station.domain.recipe.position import Position
from station.errors import InvalidValue

#: Whether something works. YAML makes booleans of the words.
OnOff = Annotated[Literal["on", "off"], BeforeValidator(lambda v: {True: "on", False: "off"}.get(v, v))]


class Run(StrictModel):
    """One pass of the unit through the positions. first, last: where the order `fastest` must begin and end;
    temperature_swing_degC: by how much it gets warmer up to the middle of the run, and cools again up to its end;
    base_turn_deg: how far the whole rig is turned about the vertical from how it usually stands; filter: whether the
    units' own low-pass filter works as it usually does, or is off (or so fast that nothing of a move is left of it)."""

    seating: Name = "home"
    order: Literal["listed", "reversed", "shuffled", "fastest"] = "listed"
    first: Name | None = None
    last: Name | None = None
    temperature_offset_degC: TemperatureStep = 0.0
    prewarm_s: NotNegative = 0.0
    motors: OnOff = "on"
    # What is not stated leaves the hash of a recipe as it was.
    temperature_swing_degC: TemperatureStep = Field(default=0.0, exclude_if=lambda v: v == 0.0)
    base_turn_deg: Finite = Field(default=0.0, exclude_if=lambda v: v == 0.0)
    filter: OnOff = Field(default="on", exclude_if=lambda v: v == "on")

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
    rounding: what its converter does with the rest of a step. axes, convention: how many readings a device has whose
    kind leaves that open, and which definition they follow; left out: the kind's usual ones.
    """

    rate_hz: Positive = 100.0
    clock_tolerance_ppm: Annotated[float, Field(ge=0, le=500_000, allow_inf_nan=False)] = 200.0
    lsb: NotNegative = 0.0
    full_scale: Positive | None = None
    noise_density: NotNegative | None = None
    counter_bits: Annotated[int, Field(ge=1, le=32)] = 8
    offset_tempco: NotNegative | None = None
    gain_tempco: NotNegative | None = None
    g_sensitivity: NotNegative | None = None
    gain_std: NotNegative | None = None
    cross_std: NotNegative | None = None
    turn_on_std: NotNegative | None = None
    rounding: Literal["nearest", "truncating", "unknown"] = "unknown"
    axes: Annotated[int, Field(ge=1, le=3)] | None = None
    convention: Name | None = None


class FirmwareGate(StrictModel):
    """What a unit must run to be calibrated. versions: of 0x100A, `*` stands for anything; software_id: 0x1F56:1."""

    versions: tuple[str, ...] = ()
    software_id: Annotated[int, Field(ge=0, le=0xFFFF_FFFF)] | None = None


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
    """What the process makes: mean and standard deviation of the deviation from nominal, by kind of coefficient, or for
    each of the twelve (offset x y z, then the matrix row by row; null where nothing is known), which goes first.

    of_results: they are of this station's results, which share its systematic errors, and not of true values. units: so
    many, whose mean then says something of the error of gravity, field or rate; left out: nothing.
    """

    offset: tuple[Finite, Positive] | None = None
    gain: tuple[Finite, Positive] | None = None
    cross_axis: tuple[Finite, Positive] | None = None
    each: Annotated[tuple[tuple[Finite, Positive] | None, ...], Field(min_length=12, max_length=12)] | None = None
    of_results: bool = False
    units: Annotated[int, Field(ge=2)] | None = None


class Limits(StrictModel):
    """Acceptance limits and the decision rule (JCGM 106, ILAC-G8). Half-widths about nominal unless stated.

    offset, residual, consistency, noise: the recipe's unit; gain, cross_axis: 1; tilt_deg: degrees.
    rule: simple (no guard band) | guard-band (w = U for 95 %) | false-accept (w so that the probability of a
    false accept at the limit is at most `false_accept`). process: what units are like before they are measured, by
    which risks are computed (JCGM 106); left out: as the log's newest units were, or anything, which overstates them.
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
