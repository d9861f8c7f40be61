"""Names that differ by x, y, z alone, or by three numbers."""

import re
from collections.abc import Iterable, Iterator

#: Axes as names number them.
_NUMBERED = re.compile(r"^(?P<stem>.*?)[\[(._ ]*(?P<axis>[0-3])[\])]*$")
_AXES = ("xyz", "012", "123")


def triples(names: Iterable[tuple[int, str]]) -> Iterator[tuple[str, tuple[int, int, int]]]:
    """What is common to the names of three columns, and their places; names: places and names."""
    groups: dict[tuple[str, str], dict[str, int]] = {}
    for place, spelled in names:
        name = spelled.lower()
        for i, letter in enumerate(name):
            if letter in "xyz":
                groups.setdefault((name[:i], name[i + 1 :]), {}).setdefault(letter, place)
        if numbered := _NUMBERED.match(name):
            groups.setdefault((numbered["stem"], "\0"), {}).setdefault(numbered["axis"], place)
    for (head, tail), places in groups.items():
        for axes in _AXES:
            if all(a in places for a in axes):
                yield f"{head} {tail}".replace("\0", ""), (places[axes[0]], places[axes[1]], places[axes[2]])
                break


def are_lettered(names: Iterable[str]) -> bool:
    """Whether three of the names are of axes called x, y, z."""
    known = [name.lower() for name in names]
    found = triples(enumerate(known))
    return any(all(axis in known[i] for axis, i in zip("xyz", places, strict=True)) for _, places in found)
