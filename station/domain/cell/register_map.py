"""Which register of a PLC holds what: the model of `station.plc/1` (docs/line.md). Pure: text is read elsewhere.

What a register means is fixed by the protocol, where it lies is the map's. Each direction is one table of the PLC and
spans no more than one Modbus request reads, so that a station never sees two halves of two instants.
"""

from collections.abc import Mapping
from difflib import get_close_matches
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from station.domain.recipe.fields import Name, StrictModel
from station.errors import InvalidValue

#: Version of the protocol that this station speaks.
PROTOCOL = 1
#: Registers that one request may read (MODBUS Application Protocol V1.1b3, 6.3) and write (6.12).
MOST_READ, MOST_WRITTEN = 125, 123
#: Nests that one word of part-present bits, and two of bins, have room for.
MOST_NESTS = 16

Address = Annotated[int, Field(ge=0, le=65535)]
Bit = Annotated[int, Field(ge=0, le=15)]
Kind = Literal["u16", "u32", "i32"]

#: PLC → station: kind and count of each signal.
INPUTS: Mapping[str, tuple[Kind, int]] = {
    "protocol": ("u16", 1),
    "heartbeat": ("u16", 1),
    "starts": ("u16", 1),
    "status": ("u16", 1),
    "fault": ("u16", 1),
    "move-echo": ("u16", 1),
    "move-state": ("u16", 1),
    "target-echo": ("i32", 4),
    "actual": ("i32", 4),
    "present": ("u16", 1),
    "load": ("u32", 1),
    "load-taken": ("u32", 1),
    "bins-taken": ("u32", 1),
}

#: Station → PLC.
OUTPUTS: Mapping[str, tuple[Kind, int]] = {
    "protocol": ("u16", 1),
    "heartbeat": ("u16", 1),
    "target": ("i32", 4),
    "move": ("u16", 1),
    "go": ("u16", 1),
    "go-beat": ("u16", 1),
    "stop": ("u16", 1),
    "state": ("u16", 1),
    "light": ("u16", 1),
    "load-accepted": ("u32", 1),
    "load-done": ("u32", 1),
    "bins": ("u32", 1),
}

#: Bits of `status`.
STATUS = ("safety-ok", "door-closed", "clamps-closed", "moving", "in-position", "load-ready", "part-removed")
#: Bits of `light`.
LIGHT = ("red", "yellow", "green", "blue", "white", "flash", "sound")

WORDS: Mapping[Kind, int] = {"u16": 1, "u32": 2, "i32": 2}


def _sequence(signals: Mapping[str, tuple[Kind, int]], start: int) -> dict[str, int]:
    """Addresses one after the other."""
    found = {}
    for name, (kind, count) in signals.items():
        found[name] = start
        start += WORDS[kind] * count
    return found


def _places(given: Mapping[str, int], signals: Mapping[str, tuple[Kind, int]], most: int) -> None:
    """Refuses a signal that is unknown, missing, or overlaps another; and a block too long for one request."""
    for name in given:
        if name not in signals:
            near = get_close_matches(name, signals, n=1) or [", ".join(signals)]
            raise InvalidValue("plc-signal-unknown", below=("at", name), name=name[:40], nearest=near[0])
    if missing := [name for name in signals if name not in given]:
        raise InvalidValue("plc-signals-missing", below=("at",), names=missing)
    owner: dict[int, str] = {}
    for name, at in given.items():
        kind, count = signals[name]
        for word in range(at, at + WORDS[kind] * count):
            if word in owner:
                raise InvalidValue(
                    "plc-registers-overlap", below=("at", name), first=owner[word], second=name, address=word
                )
            owner[word] = name
    span = max(owner) - min(owner) + 1
    if max(owner) > 65535 or span > most:
        raise InvalidValue("plc-block-too-long", below=("at",), span=span, limit=most)


class Inputs(StrictModel):
    """What the PLC says. table: holding registers (FC 3) or input registers (FC 4)."""

    table: Literal["holding", "input"] = "holding"
    at: dict[str, Address] = Field(default_factory=lambda: _sequence(INPUTS, 0))

    @model_validator(mode="after")
    def _fit(self) -> Self:
        _places(self.at, INPUTS, MOST_READ)
        return self


class Outputs(StrictModel):
    """What the station says, in holding registers (FC 16, read back with FC 3)."""

    at: dict[str, Address] = Field(default_factory=lambda: _sequence(OUTPUTS, 100))

    @model_validator(mode="after")
    def _fit(self) -> Self:
        _places(self.at, OUTPUTS, MOST_WRITTEN)
        return self


def _bits(key: str, given: Mapping[str, int], names: tuple[str, ...]) -> None:
    for name in given:
        if name not in names:
            near = get_close_matches(name, names, n=1) or [", ".join(names)]
            raise InvalidValue("plc-signal-unknown", below=(key, name), name=name[:40], nearest=near[0])
    if missing := [name for name in names if name not in given]:
        raise InvalidValue("plc-signals-missing", below=(key,), names=missing)
    if twice := {bit for bit in given.values() if list(given.values()).count(bit) > 1}:
        both = [name for name, bit in given.items() if bit in twice]
        raise InvalidValue("plc-bits-overlap", below=(key, both[1]), first=both[0], second=both[1], bit=given[both[0]])


class RegisterMap(StrictModel):
    """One PLC. word_order: which half of a 32-bit number comes first; protocol: the version that its program speaks;
    status, light: the bit of each flag in its word."""

    schema_: Annotated[Literal["station.plc/1"], Field(alias="schema")] = "station.plc/1"
    name: Name = "cell"
    protocol: Annotated[int, Field(ge=1, le=65535)] = PROTOCOL
    device: Annotated[int, Field(ge=0, le=255)] = 1
    word_order: Literal["high-first", "low-first"] = "high-first"
    inputs: Inputs = Inputs()
    outputs: Outputs = Outputs()
    status: dict[str, Bit] = Field(default_factory=lambda: {name: bit for bit, name in enumerate(STATUS)})
    light: dict[str, Bit] = Field(default_factory=lambda: {name: bit for bit, name in enumerate(LIGHT)})

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.protocol != PROTOCOL:
            raise InvalidValue("plc-map-protocol", below=("protocol",), protocol=self.protocol, known=PROTOCOL)
        _bits("status", self.status, STATUS)
        _bits("light", self.light, LIGHT)
        if self.inputs.table == "holding":
            _apart(self.inputs.at, self.outputs.at)
        return self


def _apart(inputs: Mapping[str, int], outputs: Mapping[str, int]) -> None:
    read = {word: name for name, at in inputs.items() for word in _words(at, INPUTS[name])}
    for name, at in outputs.items():
        for word in _words(at, OUTPUTS[name]):
            if word in read:
                raise InvalidValue(
                    "plc-registers-overlap", below=("outputs", "at", name), first=read[word], second=name, address=word
                )


def _words(at: int, kind: tuple[Kind, int]) -> range:
    return range(at, at + WORDS[kind[0]] * kind[1])


def span(at: Mapping[str, int], signals: Mapping[str, tuple[Kind, int]]) -> range:
    """First to last register of a direction."""
    return range(min(at.values()), max(max(_words(a, signals[name])) for name, a in at.items()) + 1)


def words_from(plc: RegisterMap, kind: Kind, values: tuple[int, ...]) -> list[int]:
    """Numbers as register words. Errors: OverflowError where one does not fit."""
    found: list[int] = []
    for value in values:
        raw = value.to_bytes(2 * WORDS[kind], "big", signed=kind == "i32")
        pair = [int.from_bytes(raw[i : i + 2], "big") for i in range(0, len(raw), 2)]
        found += pair if plc.word_order == "high-first" else pair[::-1]
    return found


def numbers_of(plc: RegisterMap, kind: Kind, words: list[int]) -> tuple[int, ...]:
    """Register words as numbers."""
    size = WORDS[kind]
    found: list[int] = []
    for i in range(0, len(words), size):
        pair = words[i : i + size] if plc.word_order == "high-first" else words[i : i + size][::-1]
        raw = b"".join(word.to_bytes(2, "big") for word in pair)
        found.append(int.from_bytes(raw, "big", signed=kind == "i32"))
    return tuple(found)


def pack_bits(places: Mapping[str, int], names: frozenset[str]) -> int:
    """A word with the bits of `names` set."""
    return sum(1 << places[name] for name in names)
