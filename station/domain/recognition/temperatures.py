"""Which columns of a table are thermometers, the likeliest of the sensor itself first: by name or unit, then by what
they show."""

import re

import numpy as np

from station.domain.core.types import Floats
from station.domain.recognition.raw_table import RawColumn, RawTable

#: A thermometer shows temperatures between these, °C; in kelvin, where nothing states the unit, between those.
COLDEST, HOTTEST = -80.0, 250.0
UNSTATED_KELVIN = (230.0, 400.0)
#: What scatters by more than this, °C, and by this share of it from one reading to the next, is no temperature.
RESTLESS_DEGC, RESTLESS = 0.5, 0.5
_WORD = re.compile(r"[A-Z]?[a-zà-ÿ]+|[A-Z]+(?![a-z])|[0-9]+|[一-鿿]+")
#: `temp` ends its word, so that attempts, templates and tempi are none.
_THERMOMETER = re.compile(r"temp([eé]rat\w*)?$|^therm|温")
_DEGREES = re.compile(r"deg_?[cf]\b|° ?[cf]|celsius|fahrenheit|kelvin", re.IGNORECASE)
_OF_THE_SENSOR = re.compile(r"^(imu|sens|acc|gyr|mag|mpu|chip|die|device|dut|internal|[agm]_?temp)")
#: Among others barometers and hygrometers, which stand beside the sensor.
_OF_SOMETHING_ELSE = re.compile(
    r"^(set|target|goal|soll|cpu|gpu|ambient|room|oven|chamber|outside|battery|status|id|air|env|baro|aht|bm[ep]|dht|sht)"
)


def thermometers(table: RawTable, assigned: set[int | None]) -> list[int]:
    """Places of the columns that are thermometers by name or unit, those that show a temperature first."""
    if not table.named:
        return []
    named = [i for i in table.numeric() if i not in assigned and _is_named(table.columns[i])]
    known = [i for i in named if np.isfinite(table.numbers(i)).any()]
    return sorted(known, key=lambda i: (*_unlikely(table, i), i))


def shows_temperature(table: RawTable, place: int) -> bool:
    """Whether a column's numbers are a temperature that changes, and slowly."""
    return not any(_unlikely(table, place)[:3])


def in_celsius(column: RawColumn, values: Floats) -> Floats | None:
    """Values (n) in °C, NaN where there are none; None where they are no temperatures."""
    middle = float(np.median(values[np.isfinite(values)])) if np.isfinite(values).any() else np.nan
    unit = _unit(column)
    if unit == "k" or (not unit and _like_kelvin(middle)) or _is_mislabelled(unit, middle):
        values = values - 273.15
    elif unit == "f":
        values = (values - 32) / 1.8
    middle = float(np.nanmedian(values)) if np.isfinite(middle) else np.nan
    return values if COLDEST < middle < HOTTEST else None


def are_kelvin_called_celsius(column: RawColumn, values: Floats) -> bool:
    """Whether the header states °C and the values (n) are far above, as kelvins are."""
    known = values[np.isfinite(values)]
    return len(known) > 0 and _is_mislabelled(_unit(column), float(np.median(known)))


def _is_mislabelled(unit: str, middle: float) -> bool:
    return unit == "c" and middle >= HOTTEST and _like_kelvin(middle)


def _like_kelvin(middle: float) -> bool:
    return UNSTATED_KELVIN[0] < middle < UNSTATED_KELVIN[1]


def says_degrees(column: RawColumn) -> bool:
    """Whether the header states the unit of a temperature."""
    return bool(_unit(column) or column.unit.strip())


def _is_named(column: RawColumn) -> bool:
    named = any(_THERMOMETER.search(word) for word in _words(column.name))
    return named or bool(_DEGREES.search(column.name) or _DEGREES.search(column.unit))


def _words(name: str) -> list[str]:
    return [word.lower() for word in _WORD.findall(name)]


def _unit(column: RawColumn) -> str:
    """c, f or k, as the header states it, or the last letter of the name does; '' where nothing states one."""
    said = column.unit.strip(" []()°").lower().removeprefix("deg").strip()
    if said[:1] in ("c", "f", "k"):
        return said[0]
    *_, last = _words(column.name) or [""]
    stated = _DEGREES.search(column.name)
    word = stated.group(0).lower() if stated else last
    letter = word[0] if word in ("celsius", "fahrenheit", "kelvin") else word[-1:]
    return letter if letter in ("c", "f", "k") and (stated or len(last) == 1) else ""


def _unlikely(table: RawTable, place: int) -> tuple[bool, bool, bool, int]:
    """What speaks against a column: it is of no temperature's size; it is restless; it stands still; whose it is."""
    column = table.columns[place]
    values = in_celsius(column, table.numbers(place))
    known = np.array([]) if values is None else values[np.isfinite(values)]
    words = _words(column.name)
    else_ = any(_OF_SOMETHING_ELSE.search(w) for w in words)
    whose = 2 if else_ else 0 if any(_OF_THE_SENSOR.search(w) for w in words) else 1
    if not len(known):
        return True, True, True, whose
    scatter = float(known.std())
    steps = float(np.sqrt(np.mean(np.diff(known) ** 2) / 2)) if len(known) > 1 else 0.0
    return False, scatter > RESTLESS_DEGC and steps > RESTLESS * scatter, scatter == 0, whose
