"""Printed serials: the recipe's pattern, the check digit, and nobody twice in one fixture."""

import re
from collections.abc import Sequence
from itertools import product
from math import prod

from station.domain.core.patterns import matches_whole
from station.domain.recipe.recipe import Recipe
from station.errors import UsageError

#: Code 39's characters in the order of their values (ISO/IEC 16388, annex A).
MOD43 = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ-. $/+%"
#: Longer is no serial but a scanner reading the wrong label.
MAX_LENGTH = 64
#: Leading zeros by which spellings of one number may differ; so many spellings of a serial are told at most.
_ZEROS, _MOST_SPELLINGS = 11, 400


def check(serial: str, recipe: Recipe) -> str:
    """The serial, when it is one of this recipe's; UsageError says what is wrong with it."""
    short = serial[:40]
    if not serial or len(serial) > MAX_LENGTH or not serial.isascii() or not serial.isprintable():
        raise UsageError("serial-not-printable", serial=short, longest=MAX_LENGTH)
    if recipe.serial_pattern is not None and not matches_whole(recipe.serial_pattern, serial):
        raise UsageError("serial-not-of-pattern", serial=short, pattern=recipe.serial_pattern)
    rule = {"mod10": mod10, "mod43": mod43}.get(recipe.check_digit)
    if rule is not None and not rule(serial):
        raise UsageError("serial-check-digit", serial=short, rule=recipe.check_digit)
    return serial


def check_all(serials: Sequence[str], recipe: Recipe) -> tuple[str, ...]:
    """All serials of one fixture load or batch; UsageError also when one stands there twice, in whatever spelling."""
    known: dict[str, str] = {}
    for serial in serials:
        check(serial, recipe)
        if other := known.get(canonical(serial)):
            if other == serial:
                raise UsageError("serial-twice", serial=serial)
            raise UsageError("serial-spelt-twice", serial=serial, other=other)
        known[canonical(serial)] = serial
    return tuple(serials)


def canonical(serial: str) -> str:
    """The serial without leading zeros of its numbers: SN0001 and SN00001 are one device number, so one unit."""
    return re.sub(r"(?<!\d)0+(?=\d)", "", serial)


def spellings(serial: str) -> list[str]:
    """The serials that are this one but for leading zeros: as many as fill a number to its own length or by _ZEROS; of
    several numbers only the last one's, where all together would be too many."""
    parts = re.split(r"([0-9]+)", serial)
    numbers = range(1, len(parts), 2)
    choices = [_widths(part) if place in numbers else [part] for place, part in enumerate(parts)]
    if prod(map(len, choices)) > _MOST_SPELLINGS:
        choices = [[part] if place != numbers[-1] else _widths(part) for place, part in enumerate(parts)]
    return ["".join(chosen) for chosen in product(*choices)]


def _widths(number: str) -> list[str]:
    core = number.lstrip("0") or "0"
    return ["0" * zeros + core for zeros in range(max(len(number) - len(core), _ZEROS) + 1)]


def mod10(serial: str) -> bool:
    """Luhn's check over the digits of the serial (ISO/IEC 7812-1, annex B)."""
    digits = [int(c) for c in serial if c in "0123456789"][::-1]
    doubled = [sum(divmod(2 * d, 10)) for d in digits[1::2]]
    return len(digits) > 1 and (sum(digits[::2]) + sum(doubled)) % 10 == 0


def mod43(serial: str) -> bool:
    """Code 39's check: the last character is the sum of the others' values modulo 43."""
    if len(serial) < 2 or any(c not in MOD43 for c in serial):
        return False
    return sum(MOD43.index(c) for c in serial[:-1]) % 43 == MOD43.index(serial[-1])
