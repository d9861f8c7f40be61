"""The device map: where and how a product keeps its calibration, as data (the `map` block of dbc/<product>.yaml).

These models say what can be said; `station.domain.product.writeback` turns a calibration into bytes by them, and back.
"""

import re
from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from station.domain.product import number_format
from station.domain.product.access import TemplateAccess, UdsAccess
from station.domain.product.sdo_codes import address
from station.domain.recipe.fields import Finite, Positive, StrictModel
from station.errors import InvalidValue

AXES = "xyz"
CELLS = tuple(row + column for row in AXES for column in AXES)
WriteStep = Literal["unlock", "invalidate", "offset", "matrix", "temperature", "record", "validate", "configuration"]


def _known_format(name: str) -> str:
    number_format.parse(name)
    return name


def _known_pattern(text: str) -> str:
    try:
        groups = re.compile(text).groups
    except re.error as exc:
        raise InvalidValue("pattern-not-regular", pattern=text, why=str(exc)) from None
    if groups != 1:
        raise InvalidValue("pattern-needs-group", pattern=text)
    return text


Index = Annotated[int, Field(ge=0x0001, le=0xFFFF)]
Sub = Annotated[int, Field(ge=0, le=0xFF)]
Format = Annotated[str, AfterValidator(_known_format)]
ValueLimits = tuple[Finite, Finite]


class DeviceObject(StrictModel):
    """One object of the device. timeout_s: how long it may take to answer; left out: the station's usual time."""

    index: Index
    sub: Sub = 0
    timeout_s: Positive | None = None

    @property
    def address(self) -> tuple[int, int]:
        """(index, sub)."""
        return self.index, self.sub


class NumberObject(DeviceObject):
    """An object that keeps one number: kept = sign · value / scale, in counts of its type."""

    type: Format = "UINT32"
    scale: Positive = 1.0
    sign: Literal[1, -1] = 1
    limits: ValueLimits | None = None


class CoefficientOverride(StrictModel):
    """What one coefficient does differently from its block."""

    index: Index | None = None
    sub: Sub | None = None
    type: Format | None = None
    scale: Positive | None = None
    sign: Literal[1, -1] | None = None
    limits: ValueLimits | None = None


class CoefficientBlock(NumberObject):
    """A block of coefficients: `sub` is the first one's, the others follow; `each` lists exceptions by name.

    kept = sign · (value − nominal if from_nominal) / scale. `scale` is the value of one count (of one unit of
    the point, for Qm.n) in the recipe's unit; `limits` are those of the value, which an EDS often cannot say. axes: how
    many the device keeps coefficients of.
    """

    type: Format = "REAL32"
    from_nominal: bool = False
    axes: Annotated[int, Field(ge=1, le=3)] = 3
    each: dict[str, CoefficientOverride] = Field(default_factory=dict)

    def number(self, cell: str, sub: int) -> NumberObject:
        """Where and how the coefficient `cell` is kept, `sub` being its place in the block's order."""
        own = self.each.get(cell, CoefficientOverride())
        return NumberObject(
            index=own.index or self.index,
            sub=sub if own.sub is None else own.sub,
            timeout_s=self.timeout_s,
            type=own.type or self.type,
            scale=own.scale or self.scale,
            sign=own.sign or self.sign,
            limits=own.limits or self.limits,
        )


class OffsetBlock(CoefficientBlock):
    """An offset for each axis, x y z."""

    sub: Sub = 1

    @model_validator(mode="after")
    def _named(self) -> Self:
        _check_cells(self.each, tuple(AXES[: self.axes]))
        return self

    def cells(self) -> Iterator[tuple[str, NumberObject]]:
        """(axis, number) in the order of writing."""
        for i, axis in enumerate(AXES[: self.axes]):
            yield axis, self.number(axis, self.sub + i)


class MatrixBlock(CoefficientBlock):
    """The coefficients of each pair of axes row by row or column by column, or gains alone (`diagonal`)."""

    sub: Sub = 1
    order: Literal["row", "column", "diagonal"] = "row"

    @model_validator(mode="after")
    def _named(self) -> Self:
        _check_cells(self.each, self.names)
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Cells in the device's order; xy is row x, column y."""
        there = AXES[: self.axes]
        if self.order == "diagonal":
            return tuple(axis * 2 for axis in there)
        cells = tuple(cell for cell in CELLS if set(cell) <= set(there))
        return cells if self.order == "row" else tuple(cell[::-1] for cell in cells)

    def cells(self) -> Iterator[tuple[str, NumberObject]]:
        """(cell, number) in the order of writing."""
        for i, cell in enumerate(self.names):
            yield cell, self.number(cell, self.sub + i)


class OutputSwitch(NumberObject):
    """The switch between raw and compensated output; calibrating compensated data is the classic error."""

    type: Format = "UINT8"
    raw: int = 0
    compensated: int = 1


class UnlockObject(NumberObject):
    """What must be written before coefficients are taken, and what locks again (left out: the reset does)."""

    key: int
    lock: int | None = None


class ValidFlag(NumberObject):
    """The flag that says whether the stored calibration may be used: cleared before the writes, set after."""

    type: Format = "UINT8"
    valid: int = 1
    invalid: int = 0


class ChecksumObject(DeviceObject):
    """A checksum that the device computes over its coefficients' bytes, in the order given: CRC-32 of IEEE 802.3."""

    over: Annotated[tuple[Literal["matrix", "offset"], ...], Field(min_length=1)] = ("matrix", "offset")


class StoreCommand(DeviceObject):
    """Object 0x1010 or 0x1011: the signature makes the device store or restore; it answers afterwards."""

    sub: Sub = 1
    timeout_s: Positive | None = 5.0


class TextObject(DeviceObject):
    """An object that keeps text."""

    length: Annotated[int, Field(ge=1, le=10_000)] = 36


class SerialObject(DeviceObject):
    """Where the device keeps its serial, and which part of the printed one that is (SN0042 → 42)."""

    index: Index = 0x1018
    sub: Sub = 4
    kind: Literal["number", "text"] = "number"
    printed: Annotated[str, AfterValidator(_known_pattern)] = r"(\d+)$"


class DeviceSetting(NumberObject):
    """A setting (filter, event timer) that is recorded, set to `calibrating` for the run, and restored after it.

    in_verification: whether the verification needs it too; left out: communication objects (0x1000 to 0x1FFF) do.
    """

    name: str
    calibrating: float | None = None
    in_verification: bool | None = None

    @property
    def lasts(self) -> bool:
        """Whether it is set again for the verification."""
        return self.index < 0x2000 if self.in_verification is None else self.in_verification


class PdoSetup(StrictModel):
    """How a TPDO must send for the run; what is left out stays as it is. What was found comes back afterwards.

    number: from 1; can_id: identifier; transmission: 0 to 240 by SYNC, 254 and 255 by event; event_timer_ms; mapping:
    objects as CiA 301 writes them (0x71300116: 0x7130:01, 22 bits).
    """

    number: Annotated[int, Field(ge=1, le=512)]
    can_id: Annotated[int, Field(ge=1, le=0x1FFF_FFFF)] | None = None
    transmission: Annotated[int, Field(ge=0, le=255)] | None = None
    event_timer_ms: Annotated[int, Field(ge=0, le=65535)] | None = None
    mapping: Annotated[tuple[Annotated[int, Field(ge=0, le=0xFFFF_FFFF)], ...], Field(max_length=64)] | None = None


class PresetBlock(StrictModel):
    """How an offset comes about that is not written (CiA 410): the device, at rest, is given the reading that it should
    show, and works its offset out.

    command: where that is written; reading: where the device shows what it reads now. tries: that reading carries
    noise, so the command is repeated until the offset is the wanted number to the count.
    """

    command: OffsetBlock
    reading: OffsetBlock
    tries: Annotated[int, Field(ge=1, le=1000)] = 100


class DeviceMap(StrictModel):
    """The whole map. `stores` says which matrix and offset the device keeps, with A and b of the station's model:

    forward: measured = A·true + b, keeps A and b; inverse: true = M·(measured − b), keeps M = A⁻¹ and b;
    inverse-add: true = M·measured + c, keeps M and c = −M·b.

    Without matrix and offset nothing is written: the device is measured and certified. output `none`: it has no switch,
    and `sends` says whether its readings are raw or compensated by what it keeps. serial `label`: the device keeps
    none, so that the label alone says which unit it is. protocol: how objects are reached; `uds` and `template` say the
    rest in a block of that name; `none`: the device only sends its readings.
    """

    protocol: Literal["canopen", "uds", "template", "none"] = "canopen"
    uds: UdsAccess | None = None
    template: TemplateAccess | None = None
    stores: Literal["forward", "inverse", "inverse-add"] = "forward"
    matrix: MatrixBlock | None = None
    offset: OffsetBlock | None = None
    preset: PresetBlock | None = None
    output: OutputSwitch | Literal["none"] | None = None
    sends: Literal["raw", "compensated"] | None = None
    unlock: UnlockObject | None = None
    valid: ValidFlag | None = None
    checksum: ChecksumObject | None = None
    temperature: NumberObject | None = None
    record: TextObject | None = None
    save: StoreCommand | None = StoreCommand(index=0x1010)
    restore: StoreCommand | None = None
    configuration: DeviceObject | None = None
    serial: SerialObject | Literal["label"] = SerialObject()
    settings: tuple[DeviceSetting, ...] = ()
    pdo: tuple[PdoSetup, ...] = ()
    order: tuple[WriteStep, ...] = (
        "unlock",
        "invalidate",
        "matrix",
        "offset",
        "temperature",
        "record",
        "configuration",
        "validate",
    )

    @model_validator(mode="after")
    def _check_consistency(self) -> Self:
        for needed in ("matrix", "offset"):
            if getattr(self, needed) is not None and needed not in self.order:
                raise InvalidValue("order-incomplete", step=needed)
        if self.output == "none" and self.sends is None:
            raise InvalidValue("output-without-sends")
        if self.sends is not None and self.output != "none":
            raise InvalidValue("sends-without-output-none")
        if len(set(self.order)) != len(self.order):
            raise InvalidValue("order-step-twice")
        for protocol in ("uds", "template"):
            if (getattr(self, protocol) is not None) != (self.protocol == protocol):
                raise InvalidValue("protocol-block", protocol=self.protocol, block=protocol)
        owner: dict[tuple[int, int], str] = {}
        for name, number in self.coefficients():
            if number.address in owner:
                where = address(*number.address)
                raise InvalidValue("address-twice", first=owner[number.address], second=name, object=where)
            owner[number.address] = name
        return self

    @model_validator(mode="after")
    def _check_preset(self) -> Self:
        if self.preset is None:
            return self
        if self.offset is None or self.matrix is not None:
            raise InvalidValue("preset-without-offset")
        if self.save is None:
            raise InvalidValue("preset-needs-save")
        for part, block in (("command", self.preset.command), ("reading", self.preset.reading)):
            if block.axes != self.offset.axes:
                raise InvalidValue("preset-other-axes", part=part, count=block.axes, wanted=self.offset.axes)
        return self

    @model_validator(mode="after")
    def _check_sender(self) -> Self:
        reads = self.writes or self.output != "none" or self.serial != "label" or self.settings or self.pdo
        if self.protocol == "none" and reads:
            raise InvalidValue("protocol-none-reads")
        return self

    @property
    def writes(self) -> bool:
        """Whether the device keeps a calibration."""
        return self.matrix is not None or self.offset is not None

    @property
    def corrects(self) -> bool:
        """Whether the device's own output is corrected once it has its coefficients; else the station corrects it."""
        return self.switch is not None or self.sends == "compensated"

    @property
    def switch(self) -> OutputSwitch | None:
        """The output switch, where there is one."""
        return self.output if isinstance(self.output, OutputSwitch) else None

    @property
    def serial_object(self) -> SerialObject | None:
        """The object that holds the serial; None where the label alone says it."""
        return self.serial if isinstance(self.serial, SerialObject) else None

    def coefficients(self) -> Iterator[tuple[str, NumberObject]]:
        """(name, number) of every coefficient in the order of writing: matrix.xy, offset.z."""
        for step in self.order:
            if step in ("matrix", "offset"):
                block: MatrixBlock | OffsetBlock | None = getattr(self, step)
                for cell, number in () if block is None else block.cells():
                    yield f"{step}.{cell}", number

    def nominal(self, name: str) -> float:
        """What a coefficient is measured from: 1 on the diagonal and 0 elsewhere, where the block says so."""
        step, cell = name.split(".")
        block: MatrixBlock | OffsetBlock = getattr(self, step)
        own = block.each.get(cell, CoefficientOverride())
        deviates = block.from_nominal or number_format.parse(own.type or block.type).from_nominal
        return 1.0 if deviates and step == "matrix" and cell[0] == cell[1] else 0.0

    def timeouts(self) -> dict[tuple[int, int], float]:
        """Objects that may take another time than the usual one: (index, sub) → seconds."""
        parts = (self.switch, self.unlock, self.valid, self.checksum, self.temperature, self.record)
        objects = [*parts, self.save, self.restore, self.configuration, self.serial_object, *self.settings]
        objects += [number for _, number in self.coefficients()]
        return {o.address: o.timeout_s for o in objects if o is not None and o.timeout_s is not None}


def _check_cells(each: dict[str, CoefficientOverride], known: tuple[str, ...]) -> None:
    for cell in each:
        if cell not in known:
            raise InvalidValue("cell-unknown", cell=cell, known=known)
