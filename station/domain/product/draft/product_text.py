"""A product file as a person would write it, from what DBC and EDS suggest; every guess has a comment."""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from station.domain.can.signals import FrameLayout, SignalLayout
from station.domain.product.draft.frame_roles import FrameRoles, unit_of_sensor
from station.domain.product.draft.map_objects import (
    CONFIGURATION,
    IDENTITY,
    RESTORE,
    STORE,
    TIMER,
    BlockObjects,
    MapObjects,
)
from station.domain.product.object_dictionary import ObjectDictionary, ObjectEntry

#: Where a line's comment begins, where there is room.
COMMENT_COLUMN = 60
_PLAIN = re.compile(r"[A-Za-z_][\w.\-]*")
_WORDS = ("true", "false", "null", "none")


@dataclass(frozen=True, slots=True)
class ProductDraft:
    """What a product file is written from. node: whose identifiers the DBC has; eds: None where there is none; source:
    the files, in words."""

    name: str
    roles: FrameRoles
    node: int
    temperature: tuple[FrameLayout, SignalLayout] | None
    eds: ObjectDictionary | None
    objects: MapObjects
    source: str

    @property
    def stores(self) -> bool:
        """Whether the device keeps a calibration, as far as the EDS says."""
        return self.objects.matrix is not None

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
    yield f"  dbc: {draft.name}.dbc"
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
    if found.matrix is not None and found.offset is not None:
        yield "  stores: forward  # check: measured = A * true + b; or inverse, inverse-add"
        yield from _block("matrix", found.matrix, diagonal=draft.diagonal)
        yield from _block("offset", found.offset, diagonal=False)
        yield from _singles(found.single)
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
        if (STORE, 1) in entries:
            yield "  save: {index: 0x1010, sub: 1, timeout_s: 5}"
        if (RESTORE, 1) in entries:
            yield "  restore: {index: 0x1011, sub: 1, timeout_s: 5}"
        if (CONFIGURATION, 1) in entries and entries[CONFIGURATION, 1].writable:
            yield "  configuration: {index: 0x1020}"
    if (IDENTITY, 4) in entries:
        yield r"  serial: {index: 0x1018, sub: 4, kind: number, printed: '(\d+)$'}  # check: SN0042 is 42"
    else:
        yield "  serial: label  # the device keeps none"
    timer = entries.get((TIMER, 5))
    if timer is not None and timer.writable:
        yield "  settings:"
        yield f"    - {{name: event timer of the readings, index: 0x1800, sub: 5, type: {timer.type_name}}}"


def _aligned(line: str) -> str:
    """The line with its comment in a column of its own, where there is room."""
    text, mark, comment = line.partition("  # ")
    return line if not mark or line.lstrip().startswith("#") else f"{text:<{COMMENT_COLUMN}}  # {comment}"
