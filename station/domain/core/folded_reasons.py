"""The reasons of units as few messages: the root cause first, each kind of consequence once, and how many more."""

from collections.abc import Iterator, Sequence

from station.domain.core.types import Reason
from station.messages import Message, render

#: What makes all else wrong: readings in another unit, then readings cut off at the end of the range.
ROOT_CAUSES = ("readings-in-other-unit", "scale", "clipped")
#: So many reasons of one kind are stated one by one.
MOST_OF_A_KIND = 2


def folded(reasons: Sequence[Reason]) -> Iterator[Message]:
    """Messages, each without the unit's name."""
    yield from (message for _, message in _kinds(reasons))


def folded_units(units: Sequence[tuple[str, Sequence[Reason]]]) -> Iterator[str]:
    """Sentences with the names of their units: what several units share stands once. units: serial and reasons."""
    found: dict[str, list[tuple[str, Message]]] = {}
    for serial, reasons in units:
        for check, message in _kinds(reasons):
            key = check if check in ROOT_CAUSES else render(message)
            found.setdefault(key, []).append((serial, message))
    for same in found.values():
        sentences = {render(message) for _, message in same}
        if len(sentences) == 1:
            yield f"{', '.join(serial for serial, _ in same)}: {sentences.pop()}"
        elif len(same) <= MOST_OF_A_KIND:
            yield from (f"{serial}: {render(message)}" for serial, message in same)
        else:
            others = tuple(serial for serial, _ in same[1:])
            serial, first = same[0]
            yield f"{serial}: {render(Message('and-units-like-it', first=first, count=len(others), units=others))}"


def folded_notes(notes: Sequence[Message]) -> Iterator[Message]:
    """Notes of each kind: those of one, as a wrong visit is, not more than a person reads."""
    kinds: dict[str, list[Message]] = {}
    for note in notes:
        kinds.setdefault(note.id, []).append(note)
    for same in kinds.values():
        if len(same) <= MOST_OF_A_KIND:
            yield from same
        else:
            yield Message("and-more-like-it", first=same[0], count=len(same) - 1)


def _kinds(reasons: Sequence[Reason]) -> Iterator[tuple[str, Message]]:
    """(check, message) of each kind, the root cause first."""
    kinds: dict[str, list[Reason]] = {check: [] for check in ROOT_CAUSES}
    for reason in reasons:
        kinds.setdefault(reason.check, []).append(reason)
    for check, same in kinds.items():
        if len(same) <= MOST_OF_A_KIND:
            yield from ((check, reason.message) for reason in same)
        else:
            yield check, Message("and-more-like-it", first=same[0].message, count=len(same) - 1)
