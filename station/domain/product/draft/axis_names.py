"""Which axis a signal's name means, and what the name is without it."""

import re
from collections.abc import Mapping

_WORDS = {
    "roll": "x", "pitch": "y", "yaw": "z", "longitudinal": "x", "lateral": "y", "transverse": "y", "vertical": "z",
    "long": "x", "lat": "y", "vert": "z",
}  # fmt: skip
_TILTS = {"pitch": "x", "roll": "y"}
#: The letter alone, at a border of camel case or words, or behind the usual letters of a quantity.
_PATTERNS = (
    re.compile(r"(?<![A-Za-z])([xyzXYZ])(?![A-Za-z])"),
    re.compile(r"(?<=[a-z0-9])([XYZ])(?![a-z])"),
    re.compile(r"(?:(?<=^[aAgGmMwW])|(?<=acc)|(?<=gyr)|(?<=gyro)|(?<=mag)|(?<=rate)|(?<=ACC)|(?<=GYRO)|(?<=MAG))"
               r"([xyzXYZ])(?![a-z])"),
)  # fmt: skip


_NUMBER, _NUMBERS = re.compile(r"[0-9]+"), {"1": "x", "2": "y", "3": "z"}
#: Between the words of a name in camel case.
_HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")


def axis_of(name: str) -> tuple[str, str] | None:
    """(stem, axis): `AccX` is (`Acc*`, `x`), `YAW_RATE` (`*_rate`, `z`); None where the name means no axis."""
    for pattern in _PATTERNS:
        if found := pattern.search(name):
            return f"{name[: found.start()]}*{name[found.end() :]}".lower(), found[1].lower()
    return _axis_by_word(_HUMP.sub("_", name), _WORDS)


def axis_by_number(name: str) -> tuple[str, str] | None:
    """The same where axes are numbered: `ACC_1_RAW` is (`acc_*_raw`, `x`); None where no single number is 1 to 3."""
    found = [m for m in _NUMBER.finditer(name) if m[0] in _NUMBERS]
    if len(found) != 1:
        return None
    (number,) = found
    return f"{name[: number.start()]}*{name[number.end() :]}".lower(), _NUMBERS[number[0]]


def angle_of(name: str) -> tuple[str, str] | None:
    """The same for an angle against gravity, which is the axis' that it tilts: pitch is x's (CiA 410, longitudinal)."""
    by_word = _axis_by_word(_HUMP.sub("_", name), _TILTS)
    return by_word or axis_of(name)


def _axis_by_word(name: str, words: Mapping[str, str]) -> tuple[str, str] | None:
    for word, axis in words.items():
        if found := re.search(rf"(?<![a-z]){word}(?![a-z])", name.replace("_", " ").lower()):
            return f"{name[: found.start()]}*{name[found.end() :]}".lower(), axis
    return None
