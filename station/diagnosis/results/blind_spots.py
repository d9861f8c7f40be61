"""What a campaign in which nothing was found could not have shown: causes at their usual size, and what would show
them.

That the simulation accounts for a few visits says little: hardly anything could have contradicted it.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from station import plugins
from station.diagnosis.candidates.bank import smooth_causes
from station.diagnosis.results.diagnose import Diagnosis, floor_rms
from station.diagnosis.results.smallest_effect import smallest_detectable
from station.messages import Message
from station.model.effect import Effect, GoldEffect
from station.model.effects.local_gravity import LocalGravity
from station.model.model_file import EFFECTS

#: Visits that scatter by so many times what their own samples explain hold something that follows nothing recorded.
SCATTERS_BEYOND = 2.0
#: Remedies that a sentence names.
MOST_REMEDIES = 3


@dataclass(frozen=True, slots=True)
class BlindSpots:
    """Ids of the causes that would not have been found at their usual size, of how many, and what would show most of
    them, the most useful first."""

    causes: tuple[str, ...]
    of: int
    remedies: tuple[str, ...]

    @staticmethod
    def of_diagnosis(d: Diagnosis) -> "BlindSpots":
        """By the last look at the data: causes that these cannot show at all, and those that must be larger than usual.
        What only a gold reference shows is left out, and what this kind of sensor does not feel."""
        every: dict[str, type[Effect]] = {name: plugins.load(EFFECTS, name) for name in smooth_causes()}
        kinds = {
            name: kind
            for name, kind in every.items()
            if kind.acts_on(d.recipe) and not issubclass(kind, GoldEffect) and name != LocalGravity.id
        }
        smallest = smallest_detectable(d.search_result.stage, d.search_result.share)
        hidden = [
            name
            for name, kind in kinds.items()
            if name in d.not_testable
            or smallest.get(name, 0.0) > kind.parameter.typical * kind.parameter.scale(d.recipe)
        ]
        remedies = Counter(kinds[name].shown_by for name in hidden)
        return BlindSpots(tuple(hidden), len(kinds), tuple(text for text, _ in remedies.most_common(MOST_REMEDIES)))


def blind_spot_messages(d: Diagnosis, within_visits: float) -> Iterator[Message]:
    """What a diagnosis that found nothing must add, for a person. within_visits: rms of a visit's mean that the scatter
    of its samples makes, in the recipe's unit."""
    scatter = floor_rms(d.last, d.floor)
    if within_visits > 0 and scatter > SCATTERS_BEYOND * within_visits:
        yield Message("means-scatter", ratio=scatter / within_visits, scatter=scatter, unit=d.recipe.unit)
    blind = BlindSpots.of_diagnosis(d)
    if blind.causes:
        count, remedies = len(blind.causes), blind.remedies
        yield Message("causes-not-shown", count=count, of=blind.of, names=blind.causes, remedies=remedies)
