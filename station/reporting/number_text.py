"""Figures and times as a person reads them."""

import math
from typing import Any

#: Risks below this change nobody's mind; they are shown as below it.
NEGLIGIBLE_RISK = 1e-6


def format_number(value: Any, digits: int = 6) -> str:
    """A figure for a person: short, with a real minus; '–' where there is none."""
    return "–" if value is None else f"{value:.{digits}g}".replace("-", "−")


def written_unit(unit: str) -> str:
    """A unit of the recipes, which are typed on any keyboard, as a document for people writes it."""
    return unit.replace("uT", "µT").replace("degC", "°C")


def quantity_in(name: str, unit: str) -> str:
    """What heads figures of a quantity in a unit (ISO 80000-1, 7.1.4): `offset x / (deg/s)`."""
    written = written_unit(unit)
    return f"{name} / ({written})" if "/" in written else f"{name} / {written}"


def format_to_uncertainty(value: Any, spread: float | None) -> str:
    """A figure to the decimal place of the second digit of its uncertainty (GUM 7.2.6), as a person reads it."""
    if value is None or not spread or not 1e-9 < spread < 1e3:
        return format_number(value, 7)
    # 0.0000998 is 0.00010 to two digits: the place is that of the rounded spread.
    places = max(0, 1 - math.floor(math.log10(float(f"{spread:.1e}"))))
    return f"{value:z.{places}f}".replace("-", "−")


def format_risk(probability: float | None) -> str:
    """A probability of a wrong decision: two digits; what is as good as nothing as a bound."""
    if probability is not None and 0 <= probability < NEGLIGIBLE_RISK:
        return "< 0.000001"
    return format_to_uncertainty(probability, probability)


def format_time(stamp: str) -> str:
    """An ISO time stamp in UTC as a person reads it, to the second."""
    return stamp[:19].replace("T", " ") + " UTC"
