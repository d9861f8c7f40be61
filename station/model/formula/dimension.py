"""Units of formulas: powers of the recipe's unit (u), of seconds and of degrees."""

from dataclasses import dataclass
from fractions import Fraction

_SUPERSCRIPT = str.maketrans("0123456789/.-", "⁰¹²³⁴⁵⁶⁷⁸⁹ᐟ·⁻")


@dataclass(frozen=True, slots=True)
class Dimension:
    """u^reading · s^time · degC^temperature."""

    reading: Fraction = Fraction(0)
    time: Fraction = Fraction(0)
    temperature: Fraction = Fraction(0)

    @property
    def is_number(self) -> bool:
        """Whether it is a pure number."""
        return self == NUMBER

    def times(self, other: "Dimension") -> "Dimension":
        """That of a product."""
        return Dimension(self.reading + other.reading, self.time + other.time, self.temperature + other.temperature)

    def power(self, exponent: Fraction) -> "Dimension":
        """That of a power."""
        return Dimension(self.reading * exponent, self.time * exponent, self.temperature * exponent)

    def text(self) -> str:
        """As the documents write units: u·s/degC, 1/(u·degC²)."""
        powers = (("u", self.reading), ("s", self.time), ("degC", self.temperature))
        above = [_factor(name, p) for name, p in powers if p > 0]
        below = [_factor(name, -p) for name, p in powers if p < 0]
        top = "·".join(above) or "1"
        if not below:
            return top
        return f"{top}/{below[0]}" if len(below) == 1 else f"{top}/({'·'.join(below)})"


def _factor(name: str, power: Fraction) -> str:
    if power == 1:
        return name
    if power == Fraction(1, 2):
        return f"√{name}"
    return f"{name}{str(power).translate(_SUPERSCRIPT)}"


NUMBER = Dimension()
READING = Dimension(reading=Fraction(1))
SECOND = Dimension(time=Fraction(1))
HERTZ = Dimension(time=Fraction(-1))
DEGREE = Dimension(temperature=Fraction(1))
DEGREE_RATE = Dimension(temperature=Fraction(1), time=Fraction(-1))
