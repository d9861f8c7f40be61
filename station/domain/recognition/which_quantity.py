"""What a table measures where no recipe says: by the names of its columns, of the file, or by the readings' size."""

import re

import numpy as np

from station.domain.capture import rest_segments
from station.domain.core.types import Floats
from station.domain.recognition import clock, columns, visits
from station.domain.recognition.columns import Roles
from station.domain.recognition.quantities import QUANTITIES, from_magnitude, is_converter_middle, sphere
from station.domain.recognition.raw_table import ImportOptions, RawTable
from station.errors import SamplesError

#: An accelerometer's offset is this share of gravity at most.
MOST_OFFSET = 0.5
#: The rate at which rest is looked for, readings a second.
USUAL_HZ = 100.0
#: What rests scatters by less than this share of the magnitude.
STILL = 0.05
#: The length of a field that is turned scatters by less than this share of it.
STEADY = 0.15
#: Words of a file's name that tell a quantity, makers' names of sensors of it alone among them.
_WORDS = {"g": r"^(acc|adxl)", "deg/s": r"^(gyr|angular)", "uT": r"^(mag|compass|kompass|hmc|qmc|bmm)"}
#: And one that says that it holds several sensors.
_SEVERAL = r"^inertial"


def unit_of(table: RawTable, options: ImportOptions) -> str:
    """A key of QUANTITIES: of the best names; where none tells, of the file's name or the readings' size; g where
    nothing does."""
    found: dict[str, Roles] = {}
    for unit, quantity in QUANTITIES.items():
        try:
            found[unit] = columns.assign(table, options, quantity)
        except SamplesError:
            continue
    if not found:
        return next(iter(QUANTITIES))
    called = [unit for unit, roles in found.items() if roles.rank < columns.NAMELESS]
    if called:
        # Names of given columns are of these very readings, which others beside a named compass are not.
        beside = options.columns is None and "g" not in called and "g" in found
        gravity = beside and _like_gravity(table, found["g"], counts=True)
        return "g" if gravity else called[0]
    best = min(found, key=lambda unit: found[unit].rank)
    named = [u for u, word in _WORDS.items() if u in found and _in_name(table.source, word)]
    if len(named) == 1 and not _in_name(table.source, _SEVERAL):
        return named[0]
    return "uT" if "uT" in found and _like_a_field(table, found) else best


def _in_name(source: str, word: str) -> bool:
    name = re.split(r"[\\/]", source)[-1]
    parts = re.findall(r"[A-Z]?[a-z]+|[A-Z]+", name)
    return any(re.match(word, part.lower()) for part in parts)


def _like_a_field(table: RawTable, found: dict[str, Roles]) -> bool:
    """Whether readings are of no acceleration's size, or too far off its centre, and of a magnetic field's size."""
    reading = _reading(table, found["uT"].axes)
    means = _means(reading)
    centre, size = sphere(means)
    # No accelerometer is turned about a middle that is farther off than gravity is large.
    near = float(np.linalg.norm(centre)) <= size and _near_gravity(reading)
    if "g" in found and (near or _like_gravity(table, found["g"])):
        return False
    if bool(np.all(reading[:1000] % 1 == 0)):
        return (
            _is_hard_iron(centre, size)
            and visits.is_pose_each(means)
            and not _rests(table, found["uT"].time, reading, size)
        )
    off = np.abs(np.linalg.norm(means - centre, axis=1) / size - 1) if size > 0 else np.full(1, np.inf)
    low, high = QUANTITIES["uT"].sizes or (0.0, 0.0)
    return float(np.median(off)) < STEADY and any(
        low <= size * factor <= high for factor in QUANTITIES["uT"].factors.values()
    )


def _rests(table: RawTable, time: int | None, reading: Floats, size: float) -> bool:
    """Whether readings (n, 3) about a sphere of that size stand still for most of the time, as those of a sensor do
    that is turned from pose to pose; at a usual rate, where no column is time."""
    try:
        time_s = _time_s(table, time)
        edges = rest_segments.find(time_s, reading)
    except SamplesError:
        return False
    still = [b - a for a, b in edges.tolist() if np.linalg.norm(reading[a:b].std(axis=0)) < STILL * size]
    return bool(sum(still) >= len(reading) / 2)


def _time_s(table: RawTable, time: int | None) -> Floats:
    """Stamps (n) in seconds from 0. Errors: SamplesError where they go back."""
    if time is None or not np.isfinite(table.numbers(time)).all():
        return np.arange(len(table)) / USUAL_HZ
    column = table.columns[time]
    return clock.stamped(table.source, table.numbers(time), column.name, column.unit, None).time_s


def _is_hard_iron(centre: Floats, size: float) -> bool:
    """Whether counts lie off their centre by more than an accelerometer does, and not by the middle of a converter's
    range, which is one for all axes."""
    return float(np.linalg.norm(centre)) > MOST_OFFSET * size and not is_converter_middle(centre, size)


def _like_gravity(table: RawTable, roles: Roles, *, counts: bool = False) -> bool:
    """Whether readings go round near zero in a magnitude that is one g in a known unit; counts: or in a power of two of
    them, too."""
    reading = _reading(table, roles.axes)
    means = _means(reading)
    centre, radius = sphere(means)
    near = float(np.linalg.norm(centre)) <= MOST_OFFSET * radius
    turns = float(np.linalg.norm(means.std(axis=0))) > columns.LEAST_TURN * radius
    whole = counts and bool(np.all(reading[:1000] % 1 == 0))
    found = from_magnitude(means, QUANTITIES["g"], whole=whole)
    return near and turns and (found.unit != "LSB" or (whole and found.exact))


def _near_gravity(reading: Floats) -> bool:
    """Whether readings (n, 3) are of a size near one g in g or m/s², which no field of the Earth has in any unit."""
    size = np.linalg.norm(reading, axis=1)
    middle = float(np.median(size))
    g = QUANTITIES["g"].factors
    steady = bool(np.median(np.abs(size - middle)) < 2 * STEADY * middle)
    return steady and any(abs(middle * g[unit] - 1) < STEADY for unit in ("g", "m/s²"))


def _reading(table: RawTable, axes: tuple[int, int, int]) -> Floats:
    return np.nan_to_num(np.stack([table.numbers(i) for i in axes], axis=1))


def _means(reading: Floats) -> Floats:
    """Means (k, 3) over short stretches; of few readings the readings themselves."""
    rows = max(len(reading) // 1000, 1)
    return np.asarray(reading[: len(reading) // rows * rows].reshape(-1, rows, 3).mean(axis=1))
