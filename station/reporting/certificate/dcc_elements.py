"""Elements of a DCC: names, texts and D-SI quantities."""

from typing import Any
from xml.etree import ElementTree as ET

from station.domain.methods import coverage
from station.reporting.certificate.facts import STANDARD_GRAVITY

DCC, SI = "https://ptb.de/dcc", "https://ptb.de/si"
#: D-SI unit and factor of the recipe's units.
UNITS = {
    "g": (r"\metre\second\tothe{-2}", STANDARD_GRAVITY),
    "uT": (r"\micro\tesla", 1.0),
    "deg/s": (r"\degree\second\tothe{-1}", 1.0),
    "deg": (r"\degree", 1.0),
    "1": (r"\one", 1.0),
}
UNKNOWN = "not stated"
#: A coverage factor so near the normal distribution's is its; others are Student's.
_NORMAL_WITHIN = 0.005


def add_element(into: ET.Element, tag: str, words: str | None = None) -> ET.Element:
    """An element of the DCC inside another."""
    made = ET.SubElement(into, dcc_tag(tag))
    made.text = words
    return made


def add_text(into: ET.Element, tag: str, words: str) -> None:
    """A text in English; what nobody stated says so."""
    add_element(add_element(into, tag), "content", _printable(words) or UNKNOWN).set("lang", "en")


def add_quantity(into: ET.Element, name: str, value: tuple[float, str]) -> ET.Element:
    """A named quantity, a D-SI real with value and unit; what comes back is the quantity."""
    quantity = add_element(into, "quantity")
    add_text(quantity, "name", name)
    real = ET.SubElement(quantity, si_tag("real"))
    ET.SubElement(real, si_tag("value")).text = repr(float(value[0]))
    ET.SubElement(real, si_tag("unit")).text = value[1]
    return quantity


def si_value(value: float, unit: str) -> tuple[float, str]:
    """A value in a recipe's unit as the DCC has it, and the D-SI name of its unit."""
    name, factor = UNITS.get(unit, (unit, 1.0))
    return value * factor, name


def add_uncertainty(
    quantity: ET.Element, expanded: float, cover: tuple[float, float], version: str, *, named: bool = True
) -> None:
    """U, k and probability of a quantity, as that version of the schema has it. cover: k, probability; named: whether
    the error is normal or Student's t, and not a sum with others, for which the D-SI has no name."""
    factor, probability = cover
    real = quantity[-1]
    if version == "3.3.0":
        into = ET.SubElement(ET.SubElement(real, si_tag("measurementUncertaintyUnivariate")), si_tag("expandedMU"))
        name = "valueExpandedMU"
    else:
        into, name = ET.SubElement(real, si_tag("expandedUnc")), "uncertainty"
    ET.SubElement(into, si_tag(name)).text = repr(float(expanded))
    ET.SubElement(into, si_tag("coverageFactor")).text = repr(float(factor))
    ET.SubElement(into, si_tag("coverageProbability")).text = repr(float(probability))
    if not named:
        return
    normal = abs(factor - coverage.NORMAL) < _NORMAL_WITHIN
    ET.SubElement(into, si_tag("distribution")).text = "normal" if normal else "t"


def xml_word(words: Any) -> str:
    """Text that is not empty and has no blanks at its ends."""
    return " ".join(_printable(str(words)).split()) or UNKNOWN


def _printable(words: str) -> str:
    """Without what XML cannot hold."""
    return "".join(c if c.isprintable() else " " for c in words).strip()


def dcc_tag(tag: str) -> str:
    """Qualified name."""
    return f"{{{DCC}}}{tag}"


def si_tag(tag: str) -> str:
    """Qualified name."""
    return f"{{{SI}}}{tag}"
