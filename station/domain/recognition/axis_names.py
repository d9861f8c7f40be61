"""Names that differ by x, y, z alone, or by three numbers; turn rates about roll, pitch and yaw."""

import re
from collections.abc import Iterable, Iterator

#: Axes as names number them.
_NUMBERED = re.compile(r"^(?P<stem>.*?)[\[(._ ]*(?P<axis>[0-3])[\])]*$")
_AXES = ("xyz", "012", "123")
#: Columns of a matrix, which has more of them than axes.
_OF_MATRIX = re.compile(r"^(?P<stem>.*?)[\[(._ ]*(?P<number>[4-9]|[1-9][0-9]+)[\])]*$")
#: m1, m2, m3 are motors as often as axes of a magnetometer, so that their name tells nothing.
_MOTORS = ("m", "\0")
#: Turn rates as aviators call them, and what their names have in common then.
_TURN = re.compile(r"roll|pitch|yaw")
_TURNS = {"p": "x", "q": "y", "r": "z", "roll": "x", "pitch": "y", "yaw": "z"}
_IS_RATE = re.compile(r"rate|gyr|omega|speed|dps")
TURN_RATE = "turn rate"


def triples(names: Iterable[tuple[int, str]]) -> Iterator[tuple[str, tuple[int, int, int]]]:
    """What is common to the names of three columns, and their places; names: places and names."""
    groups: dict[tuple[str, str], dict[str, int]] = {}
    names = list(names)
    matrices = {m["stem"] for _, spelled in names if (m := _OF_MATRIX.match(spelled.lower()))}
    for place, spelled in names:
        name = spelled.lower()
        for i, letter in enumerate(name):
            if letter in "xyz":
                groups.setdefault((name[:i], name[i + 1 :]), {}).setdefault(letter, place)
        turn = _TURN.search(name) if _IS_RATE.search(name) else None
        if name in ("p", "q", "r") or turn:
            about = turn.group() if turn else name
            beside = _TURN.sub("", name) if turn else ""
            groups.setdefault((TURN_RATE, beside), {}).setdefault(_TURNS[about], place)
        numbered = _NUMBERED.match(name)
        if numbered and numbered["stem"] not in matrices:
            groups.setdefault((numbered["stem"], "\0"), {}).setdefault(numbered["axis"], place)
    for (head, tail), places in groups.items():
        if (head, tail) == _MOTORS:
            continue
        for axes in _AXES:
            if all(a in places for a in axes):
                yield f"{head} {tail}".replace("\0", ""), (places[axes[0]], places[axes[1]], places[axes[2]])
                break


def are_lettered(names: Iterable[str]) -> bool:
    """Whether three of the names are of axes called x, y, z."""
    known = [name.lower() for name in names]
    found = triples(enumerate(known))
    return any(all(axis in known[i] for axis, i in zip("xyz", places, strict=True)) for _, places in found)
