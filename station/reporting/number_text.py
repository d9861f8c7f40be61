"""Figures and times as a person reads them."""

import math
from typing import Any


def format_number(value: Any, digits: int = 6) -> str:
    """A figure for a person: short, with a real minus; '–' where there is none."""
    return "–" if value is None else f"{value:.{digits}g}".replace("-", "−")


def format_to_uncertainty(value: Any, spread: float | None) -> str:
    """A figure to the decimal place of the second digit of its uncertainty (GUM 7.2.6), as a person reads it."""
    if value is None or not spread or not 1e-9 < spread < 1e3:
        return format_number(value, 7)
    places = max(0, 1 - math.floor(math.log10(spread)))
    return f"{value:.{places}f}".replace("-", "−")


def format_time(stamp: str) -> str:
    """An ISO time stamp in UTC as a person reads it, to the second."""
    return stamp[:19].replace("T", " ") + " UTC"
