"""Which message and signals of a DBC may carry a sensor's readings, the likeliest first."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import cast

from station import plugins
from station.domain.can.signals import FrameLayout, SignalLayout
from station.domain.core.types import EXTENDED
from station.domain.product.draft.axis_names import angle_of, axis_by_number, axis_of
from station.domain.recipe.readings import ConvertingSensor
from station.domain.recipe.sensor import PACKAGE, Sensor
from station.domain.recognition.quantities import QUANTITIES, canonical, unit_factor

_COUNTER = re.compile(r"count|cntr|cnt(?![a-z])|alive|sequence|seq(?![a-z])|rolling|^mc$", re.IGNORECASE)
_STATUS = re.compile(r"status|state|flags", re.IGNORECASE)
_TEMPERATURE = re.compile(r"temp", re.IGNORECASE)
_DEGREES = ("degc", "°c", "c", "deg c", "celsius")
#: Units that mean gravity, or gauss.
_OF_TWO = ("g", "mg")
_INCLINOMETER = "inclinometer"
_TILT = re.compile(r"tilt|incl|slope|pitch|roll|neig|level|倾", re.IGNORECASE)
#: Angles that are no tilt against gravity.
_NO_TILT = re.compile(
    r"gps|gnss|posit|heading|course|steer|wheel|latitude|longitude|(?<![a-z])(lat|long?)(?![a-z])|accuracy|rate|crank",
    re.IGNORECASE,
)
#: Identifiers of the four TPDOs (CiA 301, 7.3.5): the node id is what stands behind them.
_FIRST_TPDO, _LAST_TPDO = 0x180, 0x4FF
_LEAST_BITS = 6
#: What speaks for a proposal: as many axes as a sensor has, a unit that fits, a name that fits, equal signals.
_AXES, _UNIT, _WORD, _EQUAL = 4.0, 4.0, 2.0, 1.0
#: Signals and message both name the quantity.
_BOTH = 0.5
#: What speaks against one: its axes stand in several messages.
_APART = 1.0
#: Or its axes are numbers.
_NUMBERED = 2.0
#: What speaks for each angle of an inclinometer: less than for an axis, as those who send angles send readings, too.
_ANGLES = 1.0


@dataclass(frozen=True, slots=True)
class FrameRoles:
    """A proposal. signals: of x, y and z (None: no such axis); unit: as the DBC writes it, '' where it writes none or
    one that is not the sensor's; score: how much speaks for it; frames: the message of each signal where they are
    several, else empty."""

    sensor: str
    message: FrameLayout
    signals: tuple[SignalLayout | None, ...]
    unit: str
    score: float
    frames: tuple[FrameLayout, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether as many axes are there as a sensor of the kind has."""
        return sum(signal is not None for signal in self.signals) in axes_of_sensor(self.sensor)

    @property
    def in_counts(self) -> bool:
        """Whether the DBC gives the converter's counts: integers without a factor and without a unit."""
        counts = (s.scale == 1 and s.offset == 0 and not s.is_float for s in self.signals if s is not None)
        return not self.unit and all(counts)

    def places(self) -> tuple[str, ...]:
        """Each axis' signal as a product file names it: with its message where that is not `message`; '' for none."""
        frames = self.frames or (self.message,) * len(self.signals)
        return tuple(
            "" if s is None else s.name if frame.name == self.message.name else f"{frame.name}.{s.name}"
            for frame, s in zip(frames, self.signals, strict=True)
        )

    @property
    def counter(self) -> SignalLayout | None:
        """The signal that seems to count the frames."""
        found = (s for s in self.message.signals if _COUNTER.search(s.name))
        return next((s for s in found if not (s.signed or s.is_float or s.selector or s.length > 32)), None)

    @property
    def status(self) -> SignalLayout | None:
        """The signal that seems to be the sensor's state."""
        found = (s for s in self.message.signals if _STATUS.search(s.name))
        return next((s for s in found if not (s.signed or s.is_float or s.selector)), None)

    @property
    def node(self) -> int:
        """The node id that the DBC describes, where the identifier is a TPDO's; 1 elsewhere."""
        plain = self.message.can_id
        tpdo = not plain & EXTENDED and _FIRST_TPDO < plain <= _LAST_TPDO
        return (plain & 0x7F) or 1 if tpdo else 1


def proposed_signals(
    roles: FrameRoles, temperature: tuple[FrameLayout, SignalLayout] | None
) -> dict[str, frozenset[str]]:
    """The signals that a product of these roles reads, by message."""
    frames = roles.frames or (roles.message,) * len(roles.signals)
    places = [(frame.name, s) for frame, s in zip(frames, roles.signals, strict=True)]
    places += [(roles.message.name, roles.counter), (roles.message.name, roles.status)]
    places += [] if temperature is None else [(temperature[0].name, temperature[1])]
    return {name: frozenset(s.name for of, s in places if of == name and s is not None) for name, _ in places}


def unit_of_sensor(sensor: str) -> str:
    """The unit of a kind of sensor. Errors: UsageError for an unknown one."""
    return cast(type[Sensor], plugins.load(PACKAGE, sensor)).unit


def axes_of_sensor(sensor: str) -> tuple[int, ...]:
    """How many readings a sensor of the kind may have."""
    kind = plugins.load(PACKAGE, sensor)()
    return kind.axes if isinstance(kind, ConvertingSensor) else (3,)


def propose_roles(layouts: Mapping[str, FrameLayout], sensor: str | None = None) -> list[FrameRoles]:
    """Proposals, the likeliest first; of one kind of sensor where that is said."""
    units = {name: unit_of_sensor(name) for name in plugins.names(PACKAGE) if sensor in (None, name)}
    units = {name: unit for name, unit in units.items() if unit in QUANTITIES}
    found = [p for frame in layouts.values() for p in _of_message(frame, units)]
    found += _of_several(layouts, units)
    if sensor in (None, _INCLINOMETER):
        found += [p for frame in layouts.values() for p in _of_angles(frame, alone=sensor is not None)]
        units = {**units, _INCLINOMETER: unit_of_sensor(_INCLINOMETER)}
    return sorted(found, key=lambda p: (-p.score, list(units).index(p.sensor)))


def temperature_of(layouts: Mapping[str, FrameLayout], roles: FrameRoles) -> tuple[FrameLayout, SignalLayout] | None:
    """Message and signal of the sensor's own temperature: in the readings' message, else the only one of the file."""
    found = [(frame, s) for frame in layouts.values() for s in frame.signals if _is_temperature(s)]
    own = [pair for pair in found if pair[0].name == roles.message.name]
    return own[0] if own else found[0] if len(found) == 1 else None


def _of_message(frame: FrameLayout, units: Mapping[str, str]) -> Iterator[FrameRoles]:
    for axis_in, apart, least in ((axis_of, 0.0, "xy"), (axis_by_number, _NUMBERED, "xyz")):
        stems: dict[str, dict[str, SignalLayout]] = {}
        for signal in frame.signals:
            named = axis_in(signal.name)
            if named is not None and _may_be_reading(signal):
                stems.setdefault(named[0], {}).setdefault(named[1], signal)
        for stem, axes in stems.items():
            if set(least) <= set(axes):
                by_turns = _APART * any(s.selector is not None for s in axes.values())
                found = _of_sensors(frame, stem, axes, units)
                # Numbers may count anything: only a unit that fits makes three of them axes.
                yield from (
                    replace(roles, score=roles.score - apart - by_turns) for roles in found if roles.unit or not apart
                )


def _of_angles(frame: FrameLayout, *, alone: bool) -> Iterator[FrameRoles]:
    """One or two tilts of an inclinometer. alone: one of them is enough."""
    stems: dict[str, dict[str, SignalLayout]] = {}
    for signal in frame.signals:
        words = f"{frame.name} {signal.name}"
        tilt = _TILT.search(words) is not None
        angle = unit_factor(signal.unit, unit_of_sensor(_INCLINOMETER)) is not None or (tilt and not signal.unit)
        if not angle or not _may_be_reading(signal) or _NO_TILT.search(words):
            continue
        stem, axis = angle_of(signal.name) or (signal.name, "x")
        if axis in "xy" and (tilt or alone or angle_of(signal.name) is not None):
            stems.setdefault(stem, {}).setdefault(axis, signal)
    for axes in stems.values():
        if len(axes) == 2 or alone:
            signals = (*(axes.get(axis) for axis in "xy"), None)
            if signals[0] is None:
                continue
            unit = axes["x"].unit
            yield FrameRoles(_INCLINOMETER, frame, signals, unit, _ANGLES * len(axes) + _UNIT * bool(unit))


def _of_several(layouts: Mapping[str, FrameLayout], units: Mapping[str, str]) -> Iterator[FrameRoles]:
    """Axes of one name that stand in two or three messages, each once."""
    stems: dict[str, dict[str, list[tuple[FrameLayout, SignalLayout]]]] = {}
    for frame in layouts.values():
        for signal in frame.signals:
            named = axis_of(signal.name)
            if named is not None and _may_be_reading(signal):
                stems.setdefault(named[0], {}).setdefault(named[1], []).append((frame, signal))
    for stem, places in stems.items():
        if set(places) == set("xyz") and all(len(p) == 1 for p in places.values()):
            frames = tuple(places[axis][0][0] for axis in "xyz")
            signals = {axis: places[axis][0][1] for axis in "xyz"}
            if len({f.name for f in frames}) > 1 and len({s.unit for s in signals.values()}) == 1:
                for roles in _of_sensors(frames[0], stem, signals, units):
                    yield replace(roles, frames=frames, score=roles.score - _APART)


def _of_sensors(
    frame: FrameLayout, stem: str, axes: Mapping[str, SignalLayout], units: Mapping[str, str]
) -> Iterator[FrameRoles]:
    signals = tuple(axes.get(axis) for axis in "xyz")
    written = axes["x"].unit
    equal = len({(s.length, s.scale, s.signed) for s in axes.values()}) == 1
    for sensor, unit in units.items():
        quantity = QUANTITIES[unit]
        fits = canonical(written, quantity) not in (None, "LSB")
        of_another = not fits and any(canonical(written, q) not in (None, "LSB") for q in QUANTITIES.values())
        names = (stem.strip("*_ "), frame.name)
        words = sum(re.search(quantity.word, name, re.IGNORECASE) is not None for name in names)
        word = words > 0
        if fits and written.strip() in _OF_TWO and quantity.unit != "g":
            fits = word  # a lower-case g is gravity's, unless the names speak of a magnetic field
        if of_another or not (fits or word):
            continue
        score = _AXES * (len(axes) - 2) + _UNIT * fits + _WORD * word + _EQUAL * equal + _BOTH * (words == 2)
        yield FrameRoles(sensor, frame, signals, written if fits else "", score)


def _may_be_reading(signal: SignalLayout) -> bool:
    """Whether it has more values than a flag or a quality."""
    return signal.length >= _LEAST_BITS


def _is_temperature(signal: SignalLayout) -> bool:
    named = bool(_TEMPERATURE.search(signal.name))
    return signal.selector is None and named and signal.unit.strip().lower() in (*_DEGREES, "")
