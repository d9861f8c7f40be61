"""What a sensor kind must say of itself. Kinds are the files of `station.domain.recipe.sensors`."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, Protocol, cast

from station import plugins
from station.domain.core.types import Floats

if TYPE_CHECKING:
    from station.domain.recipe.recipe import Recipe

PACKAGE = "station.domain.recipe.sensors"


class Sensor(Protocol):
    """A sensor kind. unit: of its readings; quantity: what it measures, in words; sources: what may excite it;
    feels_earth_rate: whether the Earth's turning is part of its stimulus; large_offset: whether a good unit's offset
    may exceed the stimulus, so that neither size nor direction of a raw reading says anything; usual_tempcos: of offset
    (unit/degC) and gain (1/degC), as data sheets usually bound them; usual_turn_on: of the offset from one power-on to
    another, likewise; where a kind has none, they are 0."""

    unit: ClassVar[str]
    quantity: ClassVar[str]
    sources: ClassVar[tuple[str, ...]]
    feels_earth_rate: ClassVar[bool]
    large_offset: ClassVar[bool]
    usual_tempcos: ClassVar[tuple[float, float]]
    usual_turn_on: ClassVar[float]

    def truth_errors(
        self, recipe: "Recipe", position: tuple[str, ...], seating: tuple[str, ...], true: Floats
    ) -> Mapping[str, Floats]:
        """What its own stimulus may be wrong by, by name of the budget line: patterns (k, v, 3), one standard
        deviation each, of deviations of the truth (v, 3) in the device's frame that all visits share. A gold
        reference in its place is no matter of the kind: references.truth_errors."""

    def nuisance(self, recipe: "Recipe", position: tuple[str, ...], seating: tuple[str, ...]) -> Floats:
        """Regressors (v, q) that each axis feels besides the stimulus and that a fit may take out; q may be 0."""


def of(recipe: "Recipe") -> Sensor:
    """The sensor kind of a recipe."""
    return cast(Sensor, plugins.load(PACKAGE, recipe.sensor)())
