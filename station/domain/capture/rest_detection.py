"""From a few tenths of a second of readings: is the part at rest, and which way is up?"""

import numpy as np

from station.domain.core.types import Floats
from station.domain.recipe import sensor
from station.domain.recipe.recipe import Recipe

#: Fewer readings tell nothing about rest.
MIN_READINGS = 8
#: A drift counts as movement beyond this many standard deviations of a difference of two half-window means.
MOVED = 4.0
#: A stimulus below this share of the recipe's strongest says nothing about which way is up.
WEAK = 0.1
#: A unit's own reading may lie this far from the face that is up before it counts as another face.
FACE_DEG = 25.0
#: Noise that nobody has specified, as a share of the stimulus.
UNKNOWN_NOISE = 0.005


def expected_noise(recipe: Recipe) -> float:
    """Standard deviation of one sample by the data sheet, in the recipe's unit: white noise up to half the rate."""
    device = recipe.device
    if device.noise_density is None:
        return UNKNOWN_NOISE * recipe.reference.strength()
    return float(np.hypot(device.noise_density * np.sqrt(device.rate_hz / 2), device.lsb / np.sqrt(12)))


def at_rest(reading: Floats, noise: float, lsb: float) -> bool:
    """Whether readings (n, 3) in order show no movement: both halves agree, and nothing swings.

    noise: what one sample may scatter by itself; swinging is scatter of more than 30 times that. A part that
    still creeps less than its own noise shows is taken for still: the dwell's own check looks closer.
    """
    half = len(reading) // 2
    if len(reading) < MIN_READINGS or not np.isfinite(reading).all():
        return False
    apart, within = compare_halves(reading)
    allowed = MOVED * np.maximum(within, noise) * np.sqrt(2 / half) + lsb
    return bool((apart <= allowed).all() and (within <= 30 * noise + lsb).all())


def compare_halves(reading: Floats) -> tuple[Floats, Floats]:
    """How far the means of both halves of readings (n, 3) lie apart (3), and the standard deviation within them (3)."""
    half = len(reading) // 2
    first, second = reading[:half], reading[half:]
    within = np.sqrt((first.var(axis=0) + second.var(axis=0)) / 2)
    return np.abs(first.mean(axis=0) - second.mean(axis=0)), np.asarray(within)


def angle_deg(reading: Floats, true: Floats) -> float:
    """Angle between a mean reading (3) and the true stimulus (3); 180 where either has no direction."""
    size = float(np.linalg.norm(reading) * np.linalg.norm(true))
    if not size > 0:
        return 180.0
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(reading, true)), reading @ true)))


def has_direction(true: Floats, recipe: Recipe) -> bool:
    """Whether readings of a unit not yet calibrated must point along this stimulus (3).

    Not where the pose is unknown; not for a magnetometer, whose hard iron may be larger than the field; not for a
    stimulus as weak as an offset, such as the Earth's turning at a gyroscope's rest.
    """
    if sensor.of(recipe).large_offset or not np.isfinite(true).all():
        return False
    strongest = max((float(np.linalg.norm(recipe.stimulus(p))) for p in recipe.positions), default=0.0)
    return bool(np.linalg.norm(true) >= least_directed_stimulus(strongest, recipe) > 0)


def least_directed_stimulus(strongest: float, recipe: Recipe) -> float:
    """From which strength on a stimulus has a direction for a unit not yet calibrated; strongest: of the recipe."""
    return max(WEAK * strongest, 2 * (recipe.limits.offset or 0.0))


def face(reading: Floats) -> str:
    """The axis that a mean reading (3) points along, as a person says it: +x, -z."""
    axis = int(np.argmax(np.abs(reading)))
    return f"{'+' if reading[axis] >= 0 else '-'}{'xyz'[axis]}"
