"""Numbers as a person on the line says them: 0.00031 g/degC is 0.31 mg/°C."""

import math
import re
from collections.abc import Iterable, Sequence

#: Prefixes to try, largest unit first, of the units that a size may begin with.
_PREFIXES = {
    "g": (("g", 1.0), ("mg", 1e3), ("µg", 1e6)),
    "uT": (("µT", 1.0), ("nT", 1e3)),
    "deg/s": (("deg/s", 1.0), ("mdeg/s", 1e3)),
    "(deg/s)": (("(deg/s)", 1.0), ("(mdeg/s)", 1e3)),
    "rad": (("rad", 1.0), ("mrad", 1e3), ("µrad", 1e6)),
    "1": (("%", 100.0), ("ppm", 1e6)),
}
_BEGINNINGS = ("deg/s", "(deg/s)", "rad", "uT", "g", "1")
#: A unit that is itself a quotient, where something is divided by it or multiplied with it.
_QUOTIENT = re.compile(r"(?<=[/·])deg/s|deg/s(?=[·²])")


def unit_words(unit: str) -> str:
    """A unit of the documents, or words with one, as a person reads it: 1/deg/s² is 1/(deg/s)²."""
    return re.sub(r"\buT\b", "µT", _QUOTIENT.sub("(deg/s)", unit).replace("degC", "°C"))


def display_unit(values: Iterable[float], unit: str) -> tuple[float, str]:
    """Factor and unit in which values of `unit` are easy to read."""
    largest = max((abs(v) for v in values if math.isfinite(v)), default=0.0)
    unit = _QUOTIENT.sub("(deg/s)", unit)
    for start in _BEGINNINGS:
        rest = unit[len(start) :]
        if unit.startswith(start) and (not rest or rest[0] in "/·"):
            choices = _PREFIXES[start]
            if start == "1" and rest:
                choices = choices[1:]
            words, factor = next((c for c in choices if largest * c[1] >= 1.0), choices[-1] if largest else choices[0])
            return factor, words + unit_words(rest)
    return 1.0, unit_words(unit)


def format_significant(value: float, digits: int = 3) -> str:
    """A number with so many digits that mean something, no exponent where it can be helped, a real minus."""
    if not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    if "e" in text and 1e-6 <= abs(value) < 1e7:
        text = f"{float(text):.{max(0, digits - 1 - math.floor(math.log10(abs(value))))}f}"
    return text.replace("-", "−")


def format_aligned(values: Sequence[float], digits: int = 3) -> list[str]:
    """Numbers that stand beside each other: as many decimals for all as the largest of them needs, zero for what is
    far below it."""
    largest = max((abs(v) for v in values if math.isfinite(v)), default=0.0)
    places = max(0, digits - 1 - math.floor(math.log10(largest))) if largest > 0 else 0
    return [f"{v:.{places}f}".replace("-", "−") if abs(v) > 0.5 * 10**-places else "0" for v in values]


def format_size(value: float, unit: str, digits: int = 3) -> str:
    """A size with its unit."""
    factor, words = display_unit([value], unit)
    return f"{format_significant(value * factor, digits)} {words}".strip()


def format_interval(value: float, std: float, unit: str) -> str:
    """value ± 1.96 std, with as many digits as the interval deserves."""
    factor, words = display_unit([value], unit)
    wide = 1.96 * std * factor
    if not (wide > 0 and math.isfinite(wide)):
        return f"{format_significant(value * factor, 4)} {words}"
    places = max(0, 1 - math.floor(math.log10(wide)))
    low = f"{value * factor:.{places}f} ± {wide:.{places}f} {words}"
    return low.replace("-", "−")
