"""Is a dwell evidence? Everything that can be wrong with one stop of one unit, as reasons."""

from collections.abc import Iterator

import numpy as np

from station.domain.can.sensor_layout import SensorLayout
from station.domain.capture.rest_detection import angle_deg, compare_halves, expected_noise, face, has_direction
from station.domain.capture.visit import Visit
from station.domain.core.types import Floats, Reason
from station.domain.recipe.recipe import Recipe
from station.messages import Message

#: Checks that say something about the station or the handling, not about the unit.
STATION_CHECKS = frozenset(
    {"silent", "kernel-drops", "not-still", "wrong-face", "temperature", "gold-silent", "foreign-sender"}
)
#: A unit's own reading may lie this far from the face that is up before it counts as another face.
FACE_DEG = 25.0
#: Of the frames that the rate promises, so many must come: clocks and the dwell's ends cost a few.
MIN_FRAME_SHARE = 0.9
#: The rate is known to so many readings of a dwell; less than RATE_LEAST is left to the diagnosis.
RATE_COUNTS, MIN_RATE_DEVIATION = 3.0, 0.02
#: More frames than the rate promises by this share, out of turn, are another sender's: clocks are never so wrong.
EXCESS_SHARE = 0.01
#: A dwell whose halves differ by more standard deviations than this, and by more than it may matter, has moved.
MOVED = 6.0


def check(visit: Visit, true: Floats, recipe: Recipe, layout: SensorLayout) -> tuple[Reason, ...]:
    """Every reason why this visit's dwell is no evidence; nothing when it is good.

    true (3): the stimulus in the recipe's unit, NaN where the pose is unknown.
    """
    found = [*_transport(visit, recipe)]
    xyz = visit.readings
    if len(xyz) >= 2:
        found += [*_axes(visit, xyz, recipe, layout), *_rest(visit, xyz, recipe), *_face(visit, xyz, true, recipe)]
    return (*found, *_surroundings(visit, recipe))


def statistics(visit: Visit) -> dict[str, object]:
    """What the record keeps of a visit beside its raw frames."""
    trouble, xyz = visit.samples.frame_errors, visit.readings
    some = len(xyz) > 0
    return {
        "mean": xyz.mean(axis=0).tolist() if some else None,
        "std": xyz.std(axis=0, ddof=1).tolist() if len(xyz) > 1 else None,
        "count": len(xyz),
        "frames": trouble.frames,
        "lost": trouble.counter.lost,
        "gaps": trouble.counter.gaps,
        "repeats": trouble.counter.repeats,
        "late": trouble.counter.late,
        "crc_errors": trouble.crc_errors,
        "wrong_length": trouble.wrong_length,
        "kernel_drops": visit.drops,
        "temperature_degC": visit.temperature_degC,
        "emergencies": list(visit.emergencies),
    }


def _transport(d: Visit, recipe: Recipe) -> Iterator[Reason]:
    wanted = recipe.device.rate_hz * d.lasted_s
    count = int(np.count_nonzero(d.samples.usable))
    if d.samples.frame_errors.frames == 0:
        yield Reason.text(
            "silent", f"no readings came at {d.position!r}; check cable, power and node id", 0, wanted, "1"
        )
        return
    if d.drops:
        yield Reason.text(
            "kernel-drops", f"the kernel dropped {d.drops} frames at {d.position!r}; this PC is too busy", d.drops, 0
        )
    if not d.samples.frame_errors.clean:
        errors = d.samples.frame_errors.messages()
        yield Reason(Message("visit-bad-frames", position=d.position, errors=errors), check="frames")
        if (excess := _excess_frames(d, wanted)) > RATE_COUNTS + EXCESS_SHARE * wanted:
            message = Message("foreign-sender", position=d.position, excess=round(excess), due=round(wanted))
            yield Reason(message, excess, EXCESS_SHARE * wanted, "1")
    rate = _rate_hz(d)
    allowed = recipe.device.clock_tolerance_ppm * 1e-6 + RATE_COUNTS / max(count, 1)
    if rate is not None and abs(rate / recipe.device.rate_hz - 1) > max(allowed, MIN_RATE_DEVIATION):
        sentence = f"readings came at {rate:.1f} Hz at {d.position!r}, but the recipe says {recipe.device.rate_hz:g} Hz"
        yield Reason.text("rate", sentence, rate, recipe.device.rate_hz, "Hz")
    elif count < MIN_FRAME_SHARE * wanted:
        sentence = (
            f"{count} good readings at {d.position!r}, but {wanted:.0f} were due; check the rate and the bus load"
        )
        yield Reason.text("too-few", sentence, count, MIN_FRAME_SHARE * wanted)


def _excess_frames(d: Visit, wanted: float) -> float:
    """Frames beyond those that the rate promises, a device's own repeats left out: somebody else sends them."""
    errors = d.samples.frame_errors
    return errors.frames - errors.counter.repeats - wanted


def _rate_hz(d: Visit) -> float | None:
    """Rate of the frames by their own time stamps; None where frames are missing or too few."""
    time_ns = d.samples.time_ns
    if len(time_ns) < 10 or not d.samples.frame_errors.clean:
        return None
    return (len(time_ns) - 1) / max((int(time_ns[-1]) - int(time_ns[0])) / 1e9, 1e-9)


def _axes(d: Visit, xyz: Floats, recipe: Recipe, layout: SensorLayout) -> Iterator[Reason]:
    noise, unit = expected_noise(recipe), recipe.unit
    std = xyz.std(axis=0, ddof=1)
    limit = recipe.limits.noise
    for i, (axis, signal) in enumerate(zip("xyz", layout.axes, strict=True)):
        low, high = xyz[:, i].min(), xyz[:, i].max()
        ends = [v * signal.scale + signal.offset for v in signal.raw_limits()]
        top = min(recipe.device.full_scale or np.inf, max(ends))
        if high >= top - signal.scale or low <= max(-top, min(ends)) + signal.scale:
            yield Reason.text(
                "clipped", f"axis {axis} is clipped at {d.position!r}", float(max(high, -low)), float(top), unit
            )
        elif low == high and noise > abs(signal.scale) / 2:
            yield Reason.text(
                "stuck", f"axis {axis} stands still at {low:.6g} {unit} at {d.position!r}: no noise at all"
            )
        if limit is not None and std[i] > limit:
            sentence = f"axis {axis} has {std[i]:.3g} {unit} of noise at {d.position!r}, more than {limit:g}"
            yield Reason.text("noise", sentence, float(std[i]), limit, unit)


def _rest(d: Visit, xyz: Floats, recipe: Recipe) -> Iterator[Reason]:
    apart, within = compare_halves(xyz)
    matters = (recipe.limits.residual or 0.005 * recipe.reference.strength()) / 2
    moved = (apart > MOVED * within * np.sqrt(2 / max(len(xyz) // 2, 1))) & (apart > matters)
    if moved.any():
        worst = float(apart.max())
        sentence = (
            f"the readings moved by {worst:.3g} {recipe.unit} during the dwell at {d.position!r}; was it touched?"
        )
        yield Reason.text("not-still", sentence, worst, float(matters), recipe.unit)


def _face(d: Visit, xyz: Floats, true: Floats, recipe: Recipe) -> Iterator[Reason]:
    if not has_direction(true, recipe):
        return
    mean = np.asarray(xyz.mean(axis=0))
    angle = angle_deg(mean, true)
    if angle > FACE_DEG:
        sentence = f"{face(mean)} is up instead of {face(true)} at {d.position!r} ({angle:.0f} degrees off)"
        yield Reason.text("wrong-face", sentence, angle, FACE_DEG, "deg")


def _surroundings(d: Visit, recipe: Recipe) -> Iterator[Reason]:
    limits = recipe.limits.temperature_degC
    if limits is not None and d.temperature_degC is not None and not limits[0] <= d.temperature_degC <= limits[1]:
        low, high = limits
        sentence = f"{d.temperature_degC:.1f} degC at {d.position!r} is outside {low:g} to {high:g} degC"
        yield Reason.text(
            "temperature", sentence, d.temperature_degC, high if d.temperature_degC > high else low, "degC"
        )
    for emergency in d.emergencies:
        yield Reason.text("emergency", f"the device reported {emergency} at {d.position!r}")
