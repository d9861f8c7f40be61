"""A calibration as the bytes a device keeps, by its map, and back. Pure; nothing is written here."""

import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Literal

import numpy as np

from station.domain.core.types import Calibration, Floats
from station.domain.product import number_format
from station.domain.product.device_map import AXES, DeviceMap, DeviceObject, NumberObject, WriteStep
from station.domain.product.sdo_codes import address
from station.errors import InvalidValue, ProductError, UnitFault

Address = tuple[int, int]
RawValues = Mapping[Address, bytes]

SAVE, LOAD = b"save", b"load"
#: 0x1020 counts days from here (CiA 301, TIME_OF_DAY).
DAY_ZERO = datetime(1984, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class ObjectWrite:
    """One write: where, what it is called, the value meant (None for text and keys), and the bytes.

    read_back: whether reading the object afterwards must give the same bytes.
    """

    index: int
    sub: int
    name: str
    value: float | None
    raw: bytes
    timeout_s: float | None = None
    read_back: bool = True

    @property
    def address(self) -> Address:
        """(index, sub)."""
        return self.index, self.sub


def encode(device_map: DeviceMap, calibration: Calibration) -> tuple[ObjectWrite, ...]:
    """The writes of every coefficient, in the map's order.

    Errors: UnitFault when a coefficient is not finite, beyond its limits or does not fit its type; ProductError
    when the device keeps gains only and the calibration has cross-axis terms.
    """
    stored = _device_values(device_map, calibration.offset, calibration.matrix)
    if device_map.matrix is None:
        _refuse_gains(calibration)
    elif device_map.matrix.order == "diagonal":
        _refuse_cross_axis(calibration)
    return tuple(
        _write(name, number, stored[name], device_map.nominal(name)) for name, number in device_map.coefficients()
    )


def decode(device_map: DeviceMap, raws: RawValues) -> tuple[Floats, Floats]:
    """(offset (3), matrix (3, 3)) of measured = matrix · true + offset, from the bytes the device keeps.

    Errors: UnitFault when a value is missing, has a wrong length or is not finite, or the matrix has no inverse.
    """
    matrix, offset = np.eye(3), np.zeros(3)
    for name, number in device_map.coefficients():
        value = _value(name, number, device_map.nominal(name), raws)
        block, cell = name.split(".")
        if block == "offset":
            offset[AXES.index(cell)] = value
        else:
            matrix[AXES.index(cell[0]), AXES.index(cell[1])] = value
    return _forward(device_map, offset, matrix)


def neutral(device_map: DeviceMap) -> RawValues:
    """What a device holds that corrects nothing: ones on the diagonal, zeros elsewhere.

    Errors: UnitFault where the map's limits or types leave no room for them.
    """
    ones = {f"matrix.{axis}{axis}" for axis in AXES}
    writes = (_write(n, o, float(n in ones), device_map.nominal(n)) for n, o in device_map.coefficients())
    return {write.address: write.raw for write in writes}


def composed(device_map: DeviceMap, calibration: Calibration, old: RawValues) -> Calibration:
    """The calibration of the sensor itself, where the readings were already compensated by what the device kept.

    raw = A₀·reading + b₀ and reading = A·true + b, so raw = A₀·A·true + (A₀·b + b₀); uncertainties stay those of A, b.
    """
    if device_map.sends != "compensated":
        return calibration
    b, A = decode(device_map, old)
    return replace(calibration, offset=A @ calibration.offset + b, matrix=A @ calibration.matrix)


def rounding_std(device_map: DeviceMap, offset: Floats | None = None, matrix: Floats | None = None) -> Floats:
    """Standard uncertainty (12) of offset x y z and the matrix row by row, from the device's own format alone.

    A rounded number is uniform within ± half a step: step/√12 (JCGM 100, 4.3.7). Where the device keeps the
    inverse, dA = −A·dM·A and db = −A·dc − A·dM·b, to first order. offset, matrix: where; left out: ideal.
    """
    b = np.zeros(3) if offset is None else np.asarray(offset, float)
    A = np.eye(3) if matrix is None else np.asarray(matrix, float)
    stored = _device_values(device_map, b, A)
    std = np.zeros(12)
    for name, number in device_map.coefficients():
        shape = number_format.parse(number.type)
        value = number.sign * (stored[name] - device_map.nominal(name)) / number.scale
        std[_coefficient_index(name)] = shape.spacing(value) * number.scale / np.sqrt(12)
    return np.asarray(np.sqrt((_jacobian(device_map, b, A) ** 2) @ std**2))


def classify(old: RawValues, new: RawValues, read: RawValues) -> Literal["old", "new", "mixed", "other"]:
    """What a device that may be half written holds: all new, all old, some of each, or something else."""
    if all(read.get(at) == raw for at, raw in new.items()):
        return "new"
    if all(read.get(at) == old.get(at) for at in new):
        return "old"
    known = all(read.get(at) in (old.get(at), raw) for at, raw in new.items())
    return "mixed" if known else "other"


def sequence(
    device_map: DeviceMap,
    calibration: Calibration,
    *,
    record: str = "",
    temperature_degC: float | None = None,
    epoch_ns: int | None = None,
) -> tuple[ObjectWrite, ...]:
    """Every write between reading the old values and saving, in the map's order; what the map or the call
    leaves out is left out. record: the attempt that wrote; epoch_ns: when, for 0x1020. Errors: as `encode`.
    """
    coefficients = encode(device_map, calibration)
    makers: dict[WriteStep, Callable[[], Iterator[ObjectWrite]]] = {
        "unlock": lambda: _optional(unlock(device_map)),
        "invalidate": lambda: _optional(validity(device_map, valid=False)),
        "matrix": lambda: (w for w in coefficients if w.name.startswith("matrix.")),
        "offset": lambda: (w for w in coefficients if w.name.startswith("offset.")),
        "temperature": lambda: _temperature(device_map, temperature_degC),
        "record": lambda: _record(device_map, record),
        "configuration": lambda: _configuration(device_map, epoch_ns),
        "validate": lambda: _optional(validity(device_map, valid=True)),
    }
    return tuple(write for step in device_map.order for write in makers[step]())


def unlock(device_map: DeviceMap) -> ObjectWrite | None:
    """The write that lets coefficients be written; None where the product has no lock."""
    lock = device_map.unlock
    return None if lock is None else _control("unlock", lock, lock.key, read_back=False)


def validity(device_map: DeviceMap, *, valid: bool) -> ObjectWrite | None:
    """The write that marks the calibration valid or not; None where the product has no such flag."""
    flag = device_map.valid
    if flag is None:
        return None
    return _control("validate" if valid else "invalidate", flag, flag.valid if valid else flag.invalid)


def output(device_map: DeviceMap, *, raw: bool) -> ObjectWrite | None:
    """The write that switches to raw or compensated output; None where the product has no such switch."""
    switch = device_map.switch
    if switch is None:
        return None
    return _control("raw output" if raw else "compensated output", switch, switch.raw if raw else switch.compensated)


def save(device_map: DeviceMap) -> ObjectWrite | None:
    """The write of the signature `save`; it is a command, so it is never repeated and never read back. None where the
    device keeps at once what is written."""
    return None if device_map.save is None else _command("save", device_map.save, SAVE)


def expected_checksum(device_map: DeviceMap, raws: RawValues) -> bytes | None:
    """What the device's own checksum object must read for these coefficients; None where there is none."""
    if device_map.checksum is None:
        return None
    data = b"".join(
        raws[number.address]
        for step in device_map.checksum.over
        if (block := getattr(device_map, step)) is not None
        for _, number in block.cells()
    )
    return zlib.crc32(data).to_bytes(4, "little")


def _device_values(device_map: DeviceMap, b: Floats, A: Floats) -> dict[str, float]:
    """Coefficients as the device means them, by name."""
    if not (np.isfinite(A).all() and np.isfinite(b).all()):
        raise UnitFault("calibration-not-finite")
    if device_map.stores == "forward":
        matrix, offset = A, b
    else:
        matrix = _inverse(A)
        offset = b if device_map.stores == "inverse" else -matrix @ b
    stored = {f"offset.{a}": float(offset[i]) for i, a in enumerate(AXES)}
    stored |= {f"matrix.{r}{c}": float(matrix[i, j]) for i, r in enumerate(AXES) for j, c in enumerate(AXES)}
    return stored


def _forward(device_map: DeviceMap, offset: Floats, matrix: Floats) -> tuple[Floats, Floats]:
    if device_map.stores == "forward":
        return offset, matrix
    A = _inverse(matrix)
    return (offset if device_map.stores == "inverse" else -A @ offset), A


def _inverse(matrix: Floats) -> Floats:
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        inverse = np.full((3, 3), np.nan)
    if not np.isfinite(inverse).all():
        raise UnitFault("calibration-not-invertible")
    return np.asarray(inverse)


def _jacobian(device_map: DeviceMap, b: Floats, A: Floats) -> Floats:
    """d(offset, matrix) / d(kept offset, kept matrix), (12, 12)."""
    J = np.eye(12)
    if device_map.stores == "forward":
        return J
    J[3:, 3:] = -np.kron(A, A.T)
    if device_map.stores == "inverse-add":
        J[:3, :3] = -A
        J[:3, 3:] = -np.kron(A, b)
    return J


def _coefficient_index(name: str) -> int:
    block, cell = name.split(".")
    return AXES.index(cell) if block == "offset" else 3 + 3 * AXES.index(cell[0]) + AXES.index(cell[1])


def _write(name: str, number: NumberObject, value: float, nominal: float) -> ObjectWrite:
    where = address(number.index, number.sub)
    if number.limits is not None and not number.limits[0] <= value <= number.limits[1]:
        low, high = number.limits
        raise UnitFault("coefficient-out-of-range", name=name, value=value, object=where, low=low, high=high)
    try:
        raw = number_format.parse(number.type).encode(number.sign * (value - nominal) / number.scale)
    except InvalidValue as exc:
        raise UnitFault("coefficient-does-not-fit", name=name, value=value, object=where, why=exc.message) from None
    return ObjectWrite(number.index, number.sub, name, value, raw, number.timeout_s)


def _value(name: str, number: NumberObject, nominal: float, raws: RawValues) -> float:
    where = address(number.index, number.sub)
    if number.address not in raws:
        raise UnitFault("coefficient-not-read", name=name, object=where)
    try:
        stored = number_format.parse(number.type).decode(raws[number.address])
    except InvalidValue as exc:
        raise UnitFault("coefficient-not-decodable", name=name, object=where, why=exc.message) from None
    if not np.isfinite(stored):
        raise UnitFault("coefficient-not-finite", name=name, object=where)
    return number.sign * stored * number.scale + nominal


def _refuse_cross_axis(calibration: Calibration) -> None:
    if np.any(calibration.matrix[~np.eye(3, dtype=bool)]):
        raise ProductError("product-without-cross-axis")


def _refuse_gains(calibration: Calibration) -> None:
    if np.any(calibration.matrix != np.eye(3)):
        raise ProductError("product-without-gain")


def _control(name: str, number: NumberObject, value: float, *, read_back: bool = True) -> ObjectWrite:
    raw = number_format.parse(number.type).encode(number.sign * value / number.scale)
    return ObjectWrite(number.index, number.sub, name, float(value), raw, number.timeout_s, read_back)


def _command(name: str, target: DeviceObject, signature: bytes) -> ObjectWrite:
    return ObjectWrite(target.index, target.sub, name, None, signature, target.timeout_s, read_back=False)


def _optional(write: ObjectWrite | None) -> Iterator[ObjectWrite]:
    if write is not None:
        yield write


def _temperature(device_map: DeviceMap, temperature_degC: float | None) -> Iterator[ObjectWrite]:
    if device_map.temperature is not None and temperature_degC is not None:
        yield _write("temperature", device_map.temperature, temperature_degC, 0.0)


def _record(device_map: DeviceMap, record: str) -> Iterator[ObjectWrite]:
    text = device_map.record
    if text is None or not record:
        return
    raw = record.encode("latin-1", "replace")
    if len(raw) > text.length:
        raise ProductError("record-too-long", count=len(raw), object=address(*text.address), length=text.length)
    yield ObjectWrite(text.index, text.sub, "record", None, raw, text.timeout_s)


def _configuration(device_map: DeviceMap, epoch_ns: int | None) -> Iterator[ObjectWrite]:
    """0x1020:1 days since 1984-01-01, :2 milliseconds since midnight (CiA 301, 7.5.2.23)."""
    target = device_map.configuration
    if target is None or epoch_ns is None:
        return
    milliseconds = epoch_ns // 1_000_000 - round(DAY_ZERO.timestamp()) * 1000
    days, rest = divmod(milliseconds, 86_400_000)
    for sub, name, value in ((1, "configuration date", days), (2, "configuration time", rest)):
        yield ObjectWrite(target.index, sub, name, float(value), value.to_bytes(4, "little"), target.timeout_s)
