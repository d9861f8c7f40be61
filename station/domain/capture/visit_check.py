"""Is a dwell evidence? Everything that can be wrong with one visit of one unit, as reasons."""

from collections.abc import Iterator

import numpy as np

from station.domain.can.sensor_layout import SensorLayout
from station.domain.capture.rest_detection import (
    FACE_DEG,
    angle_deg,
    compare_halves,
    expected_noise,
    face,
    has_direction,
)
from station.domain.capture.visit import Visit
from station.domain.core.types import Floats, Reason
from station.domain.recipe.recipe import Recipe
from station.messages import Message, render

#: Checks that say something about the station or the handling, not about the unit.
STATION_CHECKS = frozenset(
    {"silent", "kernel-drops", "not-still", "wrong-face", "temperature", "gold-silent", "foreign-sender"}
)
#: Of the frames that the rate promises, so many must come: clocks and the dwell's ends cost a few.
MIN_FRAME_SHARE = 0.9
#: The rate is known to so many readings of a dwell; less than MIN_RATE_DEVIATION is left to the diagnosis.
RATE_COUNTS, MIN_RATE_DEVIATION = 3.0, 0.02
#: More frames than the rate promises by this share, out of turn, are another sender's: clocks are never so wrong.
EXCESS_SHARE = 0.01
#: A dwell whose halves differ by more standard deviations than this, and by more than it may matter, has moved.
MOVED = 6.0


def check(visit: Visit, true: Floats, recipe: Recipe, layout: SensorLayout) -> tuple[Reason, ...]:
    """Every reason why this visit's dwell is no evidence; nothing when it is good.

    true (3): the stimulus in the recipe's unit, NaN where the pose is unknown.
    """
    found = [*_transport(visit, recipe), *_bad_status(visit, layout)]
    xyz = visit.readings
    if len(xyz) >= 2:
        found += [*_axes(visit, xyz, recipe, layout), *_rest(visit, xyz, recipe), *_face(visit, xyz, true, recipe)]
    return (*found, *_surroundings(visit, recipe))


def statistics(visit: Visit) -> dict[str, object]:
    """What the record keeps of a visit beside its raw frames."""
    errors, xyz = visit.samples.frame_errors, visit.readings
    some = len(xyz) > 0
    return {
        "mean": xyz.mean(axis=0).tolist() if some else None,
        "std": xyz.std(axis=0, ddof=1).tolist() if len(xyz) > 1 else None,
        "count": len(xyz),
        "frames": errors.frames,
        "lost": errors.counter.lost,
        "gaps": errors.counter.gaps,
        "repeats": errors.counter.repeats,
        "late": errors.counter.late,
        "crc_errors": errors.crc_errors,
        "wrong_length": errors.wrong_length,
        "kernel_drops": visit.drops,
        "temperature_degC": visit.temperature_degC,
        "emergencies": [render(m) for m in visit.emergencies],
    }


def _transport(d: Visit, recipe: Recipe) -> Iterator[Reason]:
    wanted = recipe.device.rate_hz * d.lasted_s
    count = int(np.count_nonzero(d.samples.usable))
    if d.samples.frame_errors.frames == 0:
        yield Reason(Message("visit-silent", position=d.position), 0, wanted, "1", check="silent")
        return
    if d.drops:
        message = Message("visit-kernel-drops", count=d.drops, position=d.position)
        yield Reason(message, d.drops, 0, check="kernel-drops")
    if not d.samples.frame_errors.clean:
        errors = d.samples.frame_errors.messages()
        yield Reason(Message("visit-bad-frames", position=d.position, errors=errors), check="frames")
        if (excess := _excess_frames(d, wanted)) > RATE_COUNTS + EXCESS_SHARE * wanted:
            message = Message("foreign-sender", position=d.position, excess=round(excess), due=round(wanted))
            yield Reason(message, excess, EXCESS_SHARE * wanted, "1")
    rate = _rate_hz(d)
    allowed = recipe.device.clock_tolerance_ppm * 1e-6 + RATE_COUNTS / max(count, 1) + _held_back(d, recipe)
    if rate is not None and abs(rate / recipe.device.rate_hz - 1) > max(allowed, MIN_RATE_DEVIATION):
        nominal = recipe.device.rate_hz
        message = Message("visit-rate", rate_hz=rate, position=d.position, nominal_hz=nominal)
        yield Reason(message, rate, nominal, "Hz", check="rate")
    elif count < MIN_FRAME_SHARE * wanted:
        message = Message("visit-too-few", count=count, position=d.position, due=wanted)
        yield Reason(message, count, MIN_FRAME_SHARE * wanted, check="too-few")


def _excess_frames(d: Visit, wanted: float) -> float:
    """Frames beyond those that the rate promises, a device's own repeats left out: somebody else sends them."""
    errors = d.samples.frame_errors
    return (errors.frames - errors.counter.repeats) * errors.readings_each - wanted


def _rate_hz(d: Visit) -> float | None:
    """Rate of the frames by their own time stamps; None where frames are missing or too few."""
    time_ns = d.samples.time_ns
    if len(time_ns) < 10 or not d.samples.frame_errors.clean:
        return None
    return (len(time_ns) - 1) / max((int(time_ns[-1]) - int(time_ns[0])) / 1e9, 1e-9)


def _held_back(d: Visit, recipe: Recipe) -> float:
    """The longest that frames were held back on their way, as a share of what their stamps span: so far the ends of the
    dwell, and with them the rate, may be off."""
    time_ns = d.samples.time_ns
    if len(time_ns) < 2:
        return 0.0
    pauses_ns = np.diff(time_ns, prepend=d.from_ns, append=d.to_ns)
    longest_s = float(pauses_ns.max()) / 1e9 - 1 / recipe.device.rate_hz
    return max(longest_s, 0.0) / max((int(time_ns[-1]) - int(time_ns[0])) / 1e9, 1e-9)


def _bad_status(d: Visit, layout: SensorLayout) -> Iterator[Reason]:
    """What the unit says against itself in the status of its readings."""
    if d.samples.status is None:
        return
    status = d.samples.status[d.samples.usable]
    for name, bits in layout.map.bad_status.items():
        if count := int(np.count_nonzero(status & np.asarray(bits, status.dtype))):
            message = Message("visit-bad-status", position=d.position, says=name, count=count, readings=len(status))
            yield Reason(message, count, 0, check="bad-status")


def _axes(d: Visit, xyz: Floats, recipe: Recipe, layout: SensorLayout) -> Iterator[Reason]:
    noise, unit = expected_noise(recipe), recipe.unit
    std = xyz.std(axis=0, ddof=1)
    limit = recipe.limits.noise
    for i, (axis, signal) in enumerate(zip("xyz", layout.axes, strict=False)):
        low, high = xyz[:, i].min(), xyz[:, i].max()
        ends = [v * signal.scale + signal.offset for v in signal.raw_limits()]
        top = min(recipe.device.full_scale or np.inf, max(ends))
        if high >= top - signal.scale or low <= max(-top, min(ends)) + signal.scale:
            message = Message("axis-clipped", axis=axis, limit=float(top), unit=unit, position=d.position)
            yield Reason(message, float(max(high, -low)), float(top), unit, check="clipped")
        elif low == high and noise > max(abs(signal.scale), recipe.device.lsb) / 2:
            message = Message("axis-without-noise", axis=axis, value=float(low), unit=unit, position=d.position)
            yield Reason(message, check="stuck")
        if limit is not None and std[i] > limit:
            value = float(std[i])
            message = Message("axis-noise", axis=axis, position=d.position, value=value, unit=unit, limit=limit)
            yield Reason(message, value, limit, unit, check="noise")


def _rest(d: Visit, xyz: Floats, recipe: Recipe) -> Iterator[Reason]:
    apart, within = compare_halves(xyz)
    matters = (recipe.limits.residual or 0.005 * recipe.reference.strength()) / 2
    moved = (apart > MOVED * within * np.sqrt(2 / max(len(xyz) // 2, 1))) & (apart > matters)
    if moved.any():
        worst = float(apart.max())
        message = Message("visit-moved", value=worst, unit=recipe.unit, position=d.position)
        yield Reason(message, worst, float(matters), recipe.unit, check="not-still")


def _face(d: Visit, xyz: Floats, true: Floats, recipe: Recipe) -> Iterator[Reason]:
    if not has_direction(true, recipe):
        return
    mean = np.asarray(xyz.mean(axis=0))
    angle = angle_deg(mean, true)
    if angle > FACE_DEG:
        faces = {"face": face(mean), "expected": face(true)}
        message = Message("visit-wrong-face", position=d.position, angle_deg=angle, **faces)
        yield Reason(message, angle, FACE_DEG, "deg", check="wrong-face")


def _surroundings(d: Visit, recipe: Recipe) -> Iterator[Reason]:
    limits = recipe.limits.temperature_degC
    if limits is not None and d.temperature_degC is not None and not limits[0] <= d.temperature_degC <= limits[1]:
        low, high = limits
        value = d.temperature_degC
        message = Message("visit-temperature", position=d.position, value=value, low=low, high=high)
        yield Reason(message, value, high if value > high else low, "degC", check="temperature")
    for emergency in d.emergencies:
        yield Reason(Message("visit-emergency", emergency=emergency, position=d.position), check="emergency")
