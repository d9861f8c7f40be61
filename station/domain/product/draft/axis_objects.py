"""Which objects of an EDS carry each axis' readings, and which keep an offset for each of them."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from station.domain.can.signals import SignalLayout
from station.domain.product.draft.axis_names import angle_of, axis_of
from station.domain.product.draft.frame_roles import FrameRoles, unit_of_sensor
from station.domain.product.draft.map_objects import FIRST_OWN, NUMBERS, OFFSET, STORE
from station.domain.product.object_dictionary import ObjectDictionary, ObjectEntry
from station.domain.product.pdo_check import mapped_pdos
from station.domain.product.sending_pdo import COMMUNICATION, EVENT_TIMER, LAST_SYNC, TRANSMISSION
from station.domain.recognition.quantities import QUANTITIES

#: Slopes of one and of both sizes (CiA 410). Behind each: its operating parameter, preset and offset.
SLOPES = (0x6010, 0x6020, 0x6110, 0x6120)
_OPERATING, _PRESET, _OFFSET = 1, 2, 3
#: Resolution of the slopes in thousandths of a degree.
RESOLUTION = (0x6000, 0)


@dataclass(frozen=True, slots=True)
class ReadingsPdo:
    """The TPDO of the readings. number: from 0; readings: the object of each axis; mapping: the objects that it must
    map for the DBC's message, as CiA 301 writes them, none where it maps them already; by_itself: whether it is sent
    without SYNC and often."""

    number: int
    readings: tuple[ObjectEntry, ...]
    mapping: tuple[int, ...]
    by_itself: bool


@dataclass(frozen=True, slots=True)
class AxisOffsets:
    """Objects that keep an offset for each axis. commands: the presets that bring it about where it cannot be written
    (CiA 410), else none; operating: of each slope, the parameter that switches its offset on."""

    offsets: tuple[ObjectEntry, ...]
    commands: tuple[ObjectEntry, ...] = ()
    operating: tuple[ObjectEntry, ...] = ()


def readings_pdo(roles: FrameRoles, dictionary: ObjectDictionary, titles: Mapping[int, str]) -> ReadingsPdo | None:
    """The TPDO with the message's identifier; None where there is none, or no objects fit the message."""
    pdo = next((p for p in mapped_pdos(dictionary) if p.can_id == roles.message.can_id), None)
    signals = [s for s in roles.signals if s is not None]
    if pdo is None or roles.frames or any(s.big_endian for s in signals):
        return None
    placed = {(m.first_bit, m.length): dictionary.entries.get(m.at) for m in pdo.objects}
    found = _whole(placed.get((s.start, s.length)) for s in signals)
    mapping: tuple[int, ...] = ()
    if not found:
        found = _mappable(roles, signals, dictionary, titles)
        mapping = tuple(e.index << 16 | e.sub << 8 | s.length for e, s in zip(found, signals, strict=False))
    return ReadingsPdo(pdo.number, found, mapping, _by_itself(pdo.number, dictionary)) if found else None


def axis_offsets(
    readings: Sequence[ObjectEntry], dictionary: ObjectDictionary, titles: Mapping[int, str]
) -> AxisOffsets | None:
    """By CiA 410 where the readings are its slopes; else numbers whose name is that of the reading and of an offset."""
    if not readings:
        return None
    if all(r.index in SLOPES for r in readings):
        return _of_slopes(readings, dictionary)
    return _by_name(readings, dictionary, titles)


def _of_slopes(readings: Sequence[ObjectEntry], dictionary: ObjectDictionary) -> AxisOffsets | None:
    offsets, commands, operating = (
        _whole(dictionary.entries.get((r.index + step, 0)) for r in readings) for step in (_OFFSET, _PRESET, _OPERATING)
    )
    if offsets and all(e.writable for e in offsets):
        return AxisOffsets(offsets, (), operating)
    store = dictionary.entries.get((STORE, 1))
    stores = store is not None and store.writable
    if offsets and commands and stores and all(e.writable for e in commands):
        return AxisOffsets(offsets, commands, operating)
    return None


def _by_name(
    readings: Sequence[ObjectEntry], dictionary: ObjectDictionary, titles: Mapping[int, str]
) -> AxisOffsets | None:
    found = []
    for reading in readings:
        own = titles.get(reading.index, "").lower() if reading.sub == 0 else reading.name.lower()
        found.append(next((e for e in _numbers(dictionary) if own and _is_offset_of(own, e, titles)), None))
    offsets = _whole(found)
    return AxisOffsets(offsets) if offsets else None


def _numbers(dictionary: ObjectDictionary) -> Iterator[ObjectEntry]:
    """The manufacturer's and the profile's own single numbers that may be written."""
    return (e for e in dictionary.entries.values() if e.index >= FIRST_OWN and e.writable and e.type_name in NUMBERS)


def _is_offset_of(reading: str, entry: ObjectEntry, titles: Mapping[int, str]) -> bool:
    title = (titles.get(entry.index, "") if entry.sub == 0 else entry.name).lower()
    return title.startswith(reading) and OFFSET.search(title[len(reading) :]) is not None


def _mappable(
    roles: FrameRoles, signals: Sequence[SignalLayout], dictionary: ObjectDictionary, titles: Mapping[int, str]
) -> tuple[ObjectEntry, ...]:
    """One object for each axis that together fill the message as the DBC has it; none where nothing fits."""
    starts = [sum(s.length for s in signals[:i]) for i in range(len(signals))]
    if [s.start for s in signals] != starts or sum(s.length for s in signals) != 8 * roles.message.length:
        return ()
    axes = [axis for axis, s in zip("xyz", roles.signals, strict=True) if s is not None]
    axis_in = axis_of if unit_of_sensor(roles.sensor) in QUANTITIES else angle_of
    groups: dict[tuple[int, str], dict[str, ObjectEntry]] = {}
    for entry in dictionary.entries.values():
        named = axis_in(entry.name if entry.sub else titles.get(entry.index, ""))
        if named is not None and entry.index >= FIRST_OWN and _fits(entry, signals[0]):
            groups.setdefault((entry.index if entry.sub else 0, named[0]), {}).setdefault(named[1], entry)
    whole = {f"{titles.get(index, '')} {stem}": g for (index, stem), g in groups.items() if set(axes) <= set(g)}
    quantity = QUANTITIES.get(unit_of_sensor(roles.sensor))
    speaking = {words: quantity is not None and re.search(quantity.word, words, re.I) is not None for words in whole}
    best = max(whole, key=lambda words: (all(whole[words][a].mappable for a in axes), speaking[words]), default=None)
    return () if best is None else tuple(whole[best][axis] for axis in axes)


def _fits(entry: ObjectEntry, signal: SignalLayout) -> bool:
    """Whether its values are of the signal's size and sign."""
    kind = "REAL" if signal.is_float else "INT" if signal.signed else "UINT"
    return entry.type_name == f"{kind}{signal.length}"


def _by_itself(number: int, dictionary: ObjectDictionary) -> bool:
    """Whether the EDS lets it be sent on the device's own events, and a timer make them; true where it says nothing."""
    kind, timer = (dictionary.entries.get((COMMUNICATION + number, sub)) for sub in (TRANSMISSION, EVENT_TIMER))
    if kind is None or timer is None or not (kind.writable and timer.writable):
        return True
    on_event = not isinstance(kind.default, int) or kind.default > LAST_SYNC
    return on_event and timer.default != 0


def _whole(entries: Iterable[ObjectEntry | None]) -> tuple[ObjectEntry, ...]:
    """All of them, or none where one is missing."""
    listed = tuple(entries)
    found = tuple(e for e in listed if e is not None)
    return found if len(found) == len(listed) else ()
