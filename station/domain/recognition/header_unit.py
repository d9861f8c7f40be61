"""A unit that a header states, beside what the readings at rest say of it."""

from station.domain.core.types import Floats
from station.domain.recognition.quantities import Quantity, UnitScale, from_magnitude, spans, sphere
from station.messages import Message

#: Within this factor of the stimulus a header is believed: sensors are off by a range set wrong, or by their iron.
DOUBTFUL = 2.0
#: Another unit, of gravity, makes the readings one g so nearly: a range that is set wrong by a power of two does not.
NEAR = 0.1


def believed(
    source: str, means: Floats, stated: UnitScale, quantity: Quantity, *, whole: bool
) -> tuple[UnitScale, tuple[Message, ...]]:
    """The scale that was stated, or where a header alone states it the one unit in which the mean raw readings at rest
    (k, 3) are the stimulus, if they lie all about a sphere that is far from it in the stated one; and what is said of
    that. whole: the raw numbers are integers."""
    if not stated.of_header or quantity.sizes is None or not len(means):
        return stated, ()
    low, high = quantity.sizes
    centre, radius = sphere(means)
    size = radius * stated.factor
    if not size > 0 or low / DOUBTFUL <= size <= high * DOUBTFUL or not spans(means / radius, centre / radius, 1.0):
        return stated, ()
    found = from_magnitude(means, quantity, whole=whole)
    fitting = radius * found.factor
    if not (found.exact and low * (1 - NEAR) <= fitting <= high * (1 + NEAR)):
        return stated, ()
    names = {"stated": stated.unit, "taken": found.unit, "unit": quantity.unit}
    return found, (Message("header-unit-wrong", file=source, size=size, fitting=fitting, **names),)
