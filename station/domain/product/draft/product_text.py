"""A product file as a person would write it, from what DBC and EDS suggest; every guess has a comment."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from station.domain.can.signals import FrameLayout, SignalLayout
from station.domain.product.draft.axis_objects import RESOLUTION, SLOPES, AxisOffsets, ReadingsPdo
from station.domain.product.draft.frame_roles import FrameRoles, unit_of_sensor
from station.domain.product.draft.map_objects import (
    CONFIGURATION,
    IDENTITY,
    RESTORE,
    STORE,
    BlockObjects,
    MapObjects,
)
from station.domain.product.object_dictionary import ObjectDictionary, ObjectEntry
from station.domain.product.sending_pdo import COMMUNICATION, EVENT_TIMER
from station.domain.recognition.quantities import unit_factor

#: A device that waits for SYNC is made to send so often by itself, on the last transmission type (CiA 301).
EVENT_TIMER_MS, BY_ITSELF = 10, 255
#: Of a slope's operating parameter (CiA 410): scaling on, so that preset and offset count.
_SCALING_ON = 2
#: Where a line's comment begins, where there is room.
COMMENT_COLUMN = 60
_PLAIN = re.compile(r"[A-Za-z_][\w.\-]*")
_WORDS = ("true", "false", "null", "none")


@dataclass(frozen=True, slots=True)
class ProductDraft:
    """What a product file is written from. node: whose identifiers the DBC has; eds: None where there is none; source:
    the files, in words; pdo, axis_offsets: None where the EDS offers none; frames_suffix: of the copy of the DBC."""

    name: str
    roles: FrameRoles
    node: int
    temperature: tuple[FrameLayout, SignalLayout] | None
    eds: ObjectDictionary | None
    objects: MapObjects
    source: str
    pdo: ReadingsPdo | None = None
    axis_offsets: AxisOffsets | None = None
    frames_suffix: str = ".dbc"

    @property
    def stores(self) -> bool:
        """Whether the device keeps a calibration, as far as the EDS says."""
        return self.objects.offset is not None or self.axis_offsets is not None

    @property
    def offsets_only(self) -> bool:
        """Whether it keeps offsets and no gains."""
        return self.stores and self.objects.matrix is None

    @property
    def communication(self) -> int:
        """Index of the communication parameters of the readings' TPDO."""
        return COMMUNICATION + (0 if self.pdo is None else self.pdo.number)

    @property
    def makes_send(self) -> bool:
        """Whether the readings' TPDO must be made to come by itself."""
        return self.pdo is not None and not self.pdo.by_itself

    @property
    def diagonal(self) -> bool:
        """Whether it keeps gains and no cross-axis terms."""
        return self.objects.matrix is not None and len(self.objects.matrix.cells) == 3


def product_text(draft: ProductDraft) -> str:
    """The file dbc/NAME.yaml."""
    blocks = [_head(draft), _frames(draft), _identity(draft), _map(draft)]
    return "\n".join("\n".join(_aligned(line) for line in block) + "\n" for block in blocks)


def scalar(text: str) -> str:
    """A name as YAML writes it."""
    plain = _PLAIN.fullmatch(text) is not None and text.lower() not in _WORDS
    return text if plain else json.dumps(text, ensure_ascii=False)


def _head(draft: ProductDraft) -> Iterator[str]:
    yield "# yaml-language-server: $schema=../schemas/product.json"
    yield f"# Drafted by `station init` from {draft.source}. `check` marks a guess: compare it with the data sheet."
    yield "schema: station.product/1"
    yield f"name: {scalar(draft.name)}"
    yield f"sensor: {draft.roles.sensor}"
    if draft.eds is not None:
        yield f"eds: {draft.name}.eds"


def _frames(draft: ProductDraft) -> Iterator[str]:
    roles = draft.roles
    yield "frames:"
    yield f"  dbc: {draft.name}{draft.frames_suffix}"
    yield f"  node_of_dbc: {draft.node}  # check: frames of node n have the DBC's identifiers - {draft.node} + n"
    named = [f"{axis}: {scalar(place)}" for axis, place in zip("xyz", roles.places(), strict=True) if place]
    if roles.counter is not None:
        named.append(f"counter: {scalar(roles.counter.name)}")
    if roles.status is not None:
        named.append(f"status: {scalar(roles.status.name)}")
    yield f"  sample: {{message: {scalar(roles.message.name)}, {', '.join(named)}}}"
    if (counted := _counter_values(roles.counter)) is not None:
        yield f"  counter_values: {counted}  # it counts from 0 to {counted - 1}, as the DBC has its range"
    if draft.temperature is not None:
        frame, signal = draft.temperature
        yield f"  temperature: {{message: {scalar(frame.name)}, signal: {scalar(signal.name)}}}"
    if not roles.unit:
        yield f"  unit: {unit_of_sensor(roles.sensor)}  # check: the DBC writes no unit"


def _counter_values(counter: SignalLayout | None) -> int | None:
    """How many values the counter takes, where the DBC gives it fewer than its bits hold."""
    if counter is None or not counter.maximum or counter.scale != 1 or counter.offset:
        return None
    values = int(counter.maximum) + 1
    return values if 2 <= values < 1 << counter.length else None


def _identity(draft: ProductDraft) -> Iterator[str]:
    if draft.eds is None:
        yield "identity: {}  # the device is taken as it is"
        return
    yield "identity:  # 0x1018, as the EDS has it; a device that reads otherwise is refused"
    for key, sub in (("vendor", 1), ("product", 2)):
        value = _default(draft.eds, IDENTITY, sub)
        if value:
            yield f"  {key}: 0x{value:08X}"
    if not any(_default(draft.eds, IDENTITY, sub) for sub in (1, 2)):
        yield "  {}  # check: the EDS names no vendor and no product code"


def _default(eds: ObjectDictionary, index: int, sub: int) -> int:
    entry = eds.entries.get((index, sub))
    return entry.default if entry is not None and isinstance(entry.default, int) else 0


def _map(draft: ProductDraft) -> Iterator[str]:
    yield "map:"
    found = draft.objects
    if found.offset is not None:
        yield "  stores: forward  # check: measured = A * true + b; or inverse, inverse-add"
        if found.matrix is not None:
            yield from _block("matrix", found.matrix, diagonal=draft.diagonal)
        yield from _block("offset", found.offset, diagonal=False)
        yield from _singles(found.single)
    elif draft.axis_offsets is not None:
        yield from _offsets_of_axes(draft, draft.axis_offsets)
    else:
        if draft.eds is None:
            yield "  protocol: none  # no EDS: the device only sends; it is measured and certified"
        yield "  output: none  # no object keeps a calibration: nothing is written"
        yield "  sends: raw"
    yield from _communication(draft)


def _block(key: str, block: BlockObjects, *, diagonal: bool) -> Iterator[str]:
    first = block.first
    words = [f"index: 0x{first.index:04X}", f"sub: {first.sub}", f"type: {first.type_name}"]
    if key == "matrix":
        words.insert(2, f"order: {'diagonal' if diagonal else 'row'}")
    note = f"check: {block.title}" if block.title else "check"
    if not first.type_name.startswith("REAL"):
        unity = first.default if key == "matrix" and isinstance(first.default, int) and first.default > 1 else 0
        words.append(f"scale: {1 / unity:.12g}" if unity else "scale: 0.0001")
        note += "; the value of one count" if not unity else "; one is its default value"
    low, high = first.low, first.high
    if low is not None and high is not None and first.type_name.startswith("REAL"):
        words.append(f"limits: [{low:g}, {high:g}]")
    yield f"  {key}: {{{', '.join(words)}}}  # {note}"


def _singles(single: Mapping[str, ObjectEntry]) -> Iterator[str]:
    texts = {
        "output": "raw: 0, compensated: 1}}  # check: which value is which",
        "valid": "valid: 1, invalid: 0}}  # check",
    }
    for key in ("output", "valid"):
        if (entry := single.get(key)) is not None:
            yield f"  {key}: {{index: 0x{entry.index:04X}, type: {entry.type_name}, {texts[key].replace('}}', '}')}"
    if "output" not in single:
        yield "  output: none  # check: no object of the EDS looks like a switch between raw and compensated readings"
        yield "  sends: raw  # check: or compensated"
    if (entry := single.get("temperature")) is not None:
        yield f"  temperature: {{index: 0x{entry.index:04X}, type: {entry.type_name}}}  # degC at the calibration"
    if (entry := single.get("record")) is not None:
        yield f"  record: {{index: 0x{entry.index:04X}, length: 36}}  # check: the attempt's id, so many bytes"
    if (entry := single.get("unlock")) is not None:
        yield f"  # unlock: {{index: 0x{entry.index:04X}, type: {entry.type_name}, key: 0x...}}  # see the data sheet"
    if (entry := single.get("checksum")) is not None:
        yield f"  # checksum: {{index: 0x{entry.index:04X}, over: [matrix, offset]}}  # if it is CRC-32 of IEEE 802.3"


def _communication(draft: ProductDraft) -> Iterator[str]:
    """Save, restore, date, serial, event timer: by CiA 301, where the EDS has them."""
    entries = {} if draft.eds is None else draft.eds.entries
    if draft.stores:
        if _takes_orders(entries, STORE):
            yield "  save: {index: 0x1010, sub: 1, timeout_s: 5}"
        else:
            yield "  save: null  # check: no 0x1010 in the EDS that may be written: what is written must last by itself"
        if _takes_orders(entries, RESTORE):
            yield "  restore: {index: 0x1011, sub: 1, timeout_s: 5}"
        if _takes_orders(entries, CONFIGURATION):
            yield "  configuration: {index: 0x1020}"
    if (IDENTITY, 4) in entries:
        yield r"  serial: {index: 0x1018, sub: 4, kind: number, printed: '(\d+)$'}  # check: SN0042 is 42"
    else:
        yield "  serial: label  # the device keeps none"
    yield from _settings(draft)
    yield from _pdo(draft)


def _takes_orders(entries: Mapping[tuple[int, int], ObjectEntry], index: int) -> bool:
    """Whether its first object is there and may be written."""
    return (index, 1) in entries and entries[index, 1].writable


def _offsets_of_axes(draft: ProductDraft, found: AxisOffsets) -> Iterator[str]:
    """A zero alone: one object an axis, written, or brought about by presets."""
    assert draft.pdo is not None
    slopes = draft.pdo.readings[0].index in SLOPES
    note = "CiA 410: taken off what is shown" if slopes else "check: added to what is shown, or taken off it"
    yield f"  offset: {_one_each(found.offsets, draft, sign=-1 if slopes else 1)}  # {note}"
    if found.commands:
        yield "  preset:  # CiA 410: the device works its offset out"
        yield f"    command: {_one_each(found.commands, draft, sign=1)}"
        yield f"    reading: {_one_each(draft.pdo.readings, draft, sign=1)}"
    yield "  output: none  # check: no object of the EDS looks like a switch between raw and compensated readings"
    yield "  sends: compensated"


def _one_each(entries: Sequence[ObjectEntry], draft: ProductDraft, *, sign: int) -> str:
    first, *others = entries
    words = [f"index: 0x{first.index:04X}, sub: {first.sub}, axes: {len(entries)}, type: {first.type_name}"]
    words.append(f"scale: {_step(draft):.12g}")
    words += ["sign: -1"] if sign < 0 else []
    each = (f"{axis}: {{index: 0x{e.index:04X}, sub: {e.sub}}}" for axis, e in zip("yz", others, strict=False))
    return f"{{{', '.join(words)}, each: {{{', '.join(each)}}}}}"


def _step(draft: ProductDraft) -> float:
    """The value of one count of the readings, in the sensor's unit."""
    unit = unit_of_sensor(draft.roles.sensor)
    signal = next(s for s in draft.roles.signals if s is not None)
    return abs(signal.scale) * (unit_factor(draft.roles.unit or unit, unit) or 1.0)


def _settings(draft: ProductDraft) -> Iterator[str]:
    lines = []
    timer = None if draft.eds is None else draft.eds.entries.get((draft.communication, EVENT_TIMER))
    if timer is not None and timer.writable and not draft.makes_send:
        lines.append(f"name: event timer of the readings, index: 0x{timer.index:04X}, sub: 5, type: {timer.type_name}")
    lasting = "in_verification: true"
    if draft.axis_offsets is not None and draft.eds is not None:
        resolution = draft.eds.entries.get(RESOLUTION)
        if resolution is not None and resolution.writable and draft.axis_offsets.operating:
            kind = resolution.type_name
            lines.append(
                f"name: resolution, index: 0x6000, type: {kind}, calibrating: {_step(draft) * 1000:g}, {lasting}"
            )
        for axis, e in zip("xy", draft.axis_offsets.operating, strict=False):
            scaling = f"name: scaling of {axis}, index: 0x{e.index:04X}, type: {e.type_name}"
            lines.append(f"{scaling}, calibrating: {_SCALING_ON}, {lasting}")
    if lines:
        yield "  settings:"
    yield from (f"    - {{{line}}}" for line in lines)


def _pdo(draft: ProductDraft) -> Iterator[str]:
    """What the TPDO needs to send the message that the DBC has, without SYNC."""
    if draft.pdo is None or not (draft.pdo.mapping or draft.makes_send):
        return
    words = [f"number: {draft.pdo.number + 1}"]
    if draft.makes_send:
        words.append(f"transmission: {BY_ITSELF}, event_timer_ms: {EVENT_TIMER_MS}")
    if draft.pdo.mapping:
        words.append(f"mapping: [{', '.join(f'0x{entry:08X}' for entry in draft.pdo.mapping)}]")
    yield "  pdo:  # check: set for the run, put back after it"
    yield f"    - {{{', '.join(words)}}}"


def _aligned(line: str) -> str:
    """The line with its comment in a column of its own, where there is room."""
    text, mark, comment = line.partition("  # ")
    return line if not mark or line.lstrip().startswith("#") else f"{text:<{COMMENT_COLUMN}}  # {comment}"
