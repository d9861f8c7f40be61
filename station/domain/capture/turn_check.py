"""Whether a fixture was turned by hand, told from readings whose direction says nothing: an offset as large as the
stimulus (a magnetometer's hard iron), or angles. And the words for the position that a person is to bring up."""

from collections.abc import Iterator

import numpy as np

from station.domain.capture.rest_detection import FACE_DEG, face
from station.domain.core.types import Floats
from station.domain.recipe.recipe import Recipe
from station.messages import Message

#: How far gains not yet calibrated may make a change of the readings differ from the one that was asked for.
GAIN_SHARE = 0.3
#: What a calibration may leave of that.
LEFT_SHARE = 0.1
#: And how far anything may: as a share of the stimulus; of angles, degrees.
NEAR_SHARE, NEAR_DEG = 0.2, 3.0
#: An axis within so many degrees of up is up, as a person says it.
UPRIGHT_DEG = 10.0
#: Other axes count as directions of a tilt from this share of the largest of them on.
TOWARDS_SHARE = 0.3


def shows(mean: Floats, true: Floats, before: tuple[Floats, Floats] | None, recipe: Recipe) -> bool:
    """Whether a mean reading (3) fits the truth (3) of the wanted position. before: mean and truth at the last one,
    with the same offset; None: an angle tells by itself, within what an uncalibrated zero may be."""
    if before is None:
        return _apart(mean, true, recipe) <= FACE_DEG
    change = true - before[1]
    allowed = GAIN_SHARE * _apart(true, before[1], recipe) + _near(true, recipe)
    return _apart(mean - before[0], change, recipe) <= allowed


def shows_calibrated(mean: Floats, true: Floats, recipe: Recipe) -> bool:
    """The same of a reading (3) that is corrected; a device that keeps a zero alone still has its gain's error."""
    return _apart(mean, true, recipe) <= _near(true, recipe) + LEFT_SHARE * float(np.linalg.norm(true))


def instruction(position: str, true: Floats, recipe: Recipe) -> Message:
    """What a person is asked to bring up where a perfect device reads `true` (3)."""
    if recipe.converts:
        reading = tuple(f"{axis} {value:+.1f}°" for axis, value in zip("xyz", true[: recipe.axes], strict=False))
        return Message("turn-to-reading", position=position, reading=reading)
    towards = tuple(_towards(true))
    if not towards:
        return Message("turn-to-position", position=position, face=face(true))
    up = float(np.abs(true).max() / np.linalg.norm(true))
    angle_deg = float(np.degrees(np.arccos(min(up, 1.0))))
    return Message("turn-to-tilt", position=position, face=face(true), angle_deg=angle_deg, towards=towards)


def _towards(true: Floats) -> Iterator[str]:
    """The axes towards which a stimulus leans away from the one that it is nearest to; none where it is upright."""
    main = int(np.argmax(np.abs(true)))
    rest = np.where(np.arange(3) == main, 0.0, true)
    if np.linalg.norm(rest) <= np.tan(np.radians(UPRIGHT_DEG)) * abs(true[main]):
        return
    for axis in np.argsort(-np.abs(rest), kind="stable"):
        if abs(rest[axis]) >= TOWARDS_SHARE * np.abs(rest).max():
            yield face(np.where(np.arange(3) == axis, rest, 0.0))


def _near(true: Floats, recipe: Recipe) -> float:
    return NEAR_DEG if recipe.converts else NEAR_SHARE * float(np.linalg.norm(true))


def _apart(one: Floats, other: Floats, recipe: Recipe) -> float:
    """How far apart, in the recipe's unit; angles go round."""
    apart = one - other
    return float(np.linalg.norm((apart + 180.0) % 360.0 - 180.0 if recipe.converts else apart))
