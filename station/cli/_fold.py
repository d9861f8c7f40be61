"""The reasons of a unit as few lines: the root cause first, each kind of consequence once, and how many more."""

from collections.abc import Iterator, Sequence

from station.domain.core.types import Reason
from station.messages import Message, render

#: What makes all else wrong: readings in another unit, then readings cut off at the end of the range.
ROOT_CAUSES = ("readings-in-other-unit", "scale", "clipped")
#: So many reasons of one kind are printed one by one.
MOST_OF_A_KIND = 2


def folded(reasons: Sequence[Reason]) -> Iterator[str]:
    """Sentences, each without the unit's name."""
    kinds: dict[str, list[Reason]] = {check: [] for check in ROOT_CAUSES}
    for reason in reasons:
        kinds.setdefault(reason.check, []).append(reason)
    for same in kinds.values():
        if len(same) <= MOST_OF_A_KIND:
            yield from (reason.sentence for reason in same)
        else:
            yield render(Message("and-more-like-it", first=same[0].message, count=len(same) - 1))
