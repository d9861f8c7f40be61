"""What tells two causes apart that no run does, as their files say.

>>> next(tie_breakers(["asymmetry", "quadratic"]))
'tilts between the faces, or other strengths: a centrifuge, coils, spins at other speeds'
"""

from collections.abc import Collection, Iterator

from station import plugins
from station.model.effect import Effect
from station.model.model_file import EFFECTS


def tie_breakers(members: Collection[str]) -> Iterator[str]:
    """What would tell two of these causes (ids) apart, in English; nothing of names that are no cause's."""
    for name in sorted(set(members) & set(plugins.names(EFFECTS))):
        kind: type[Effect] = plugins.load(EFFECTS, name)
        yield from (text for other, text in kind.separated_by if other in members)
