"""An EDS or DCF file → Dictionary. Parsed by `canopen`, with what that drops put back: REAL32 limits, lost defaults."""

import configparser
import contextlib
import io
import logging
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from canopen.objectdictionary import ODVariable
from canopen.objectdictionary.eds import import_eds

from station.adapters.canopen import eds_text
from station.domain.product.object_dictionary import TYPES, ObjectDictionary, ObjectEntry, Value
from station.domain.product.sdo_codes import address
from station.errors import ProductError
from station.messages import system_reason

logging.getLogger("canopen").addHandler(logging.NullHandler())

#: What `canopen` and the parser of sections raise where a text is not as they expect.
_REFUSED = (configparser.Error, ValueError, KeyError, AttributeError, TypeError, IndexError)
_MOST_BYTES, _MOST_OBJECTS = 4_000_000, 15_000
_EMPTY: dict[str, Value] = {"STRING": "", "OCTETS": b"", "DOMAIN": b"", "REAL32": 0.0, "REAL64": 0.0}
_STORE_EDS = 0x1021
_COMPACT = re.compile(r"^\s*CompactSubObj\s*=\s*(0x[0-9A-Fa-f]{1,4}|[0-9]{1,5})", re.MULTILINE | re.IGNORECASE)
_OBJECT_SECTION = re.compile(r"\[[0-9A-Fa-f]{4}\]")


Address = tuple[int, int]


def load(path: Path, node: int, used: frozenset[Address] | None = None) -> ObjectDictionary:
    """Reads an EDS for the device with this node id ($NODEID is worked out); 0x1021 holds the text itself.

    used: objects that somebody needs; others that cannot be understood are left out; None: every object must be
    understood. Errors: ProductError naming the file, the object and the remedy.
    """
    text = _text(path)
    try:
        found = _entries(text, used)
    except ProductError as exc:
        raise ProductError("eds-mistake", file=str(path), mistake=exc.message) from None
    except _REFUSED as exc:
        raise ProductError("eds-not-readable", file=str(path), why=" ".join(str(exc).split())[:200]) from exc
    if not found:
        raise ProductError("eds-empty", file=str(path))
    own = [replace(e, default=e.default + node) if isinstance(e.default, int) and counts else e for e, counts in found]
    return ObjectDictionary(node, {(entry.index, entry.sub): entry for entry in own})


def titles(path: Path) -> dict[int, str]:
    """Name of each object by its index, arrays and records included, which have no value of their own.

    Errors: ProductError where the file cannot be read.
    """
    found = dict[int, str]()
    index = None
    for line in _text(path).splitlines():
        text = line.strip()
        if text.startswith("["):
            index = int(text[1:5], 16) if _OBJECT_SECTION.fullmatch(text) else None
        elif index is not None and text.lower().startswith("parametername"):
            found[index] = text.partition("=")[2].strip()
    return found


@lru_cache(maxsize=8)
def _entries(text: str, used: frozenset[Address] | None) -> tuple[tuple[ObjectEntry, bool], ...]:
    """Every object for node 0, and whether its default counts from $NODEID: a fixture's nests share one parse."""
    plain = text if used is None else eds_text.cleaned(text)
    sections = _Sections(plain, strict=used is None)
    sections.check()
    found = []
    for variable in _variables(plain, lenient=used is not None):
        try:
            found.append((_entry(variable, sections, text), sections.counts_from_node(variable)))
        except ProductError:
            if used is None or (variable.index, variable.subindex) in used:
                raise
    return tuple(found)


def _text(path: Path) -> str:
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise ProductError("eds-too-long", file=str(path), limit=_MOST_BYTES)
        text = path.read_text(encoding="latin-1")
    except OSError as exc:
        raise ProductError("eds-no-access", file=str(path), why=system_reason(exc)) from exc
    objects = text.count("\n[") + sum(int(count, 0) for count in _COMPACT.findall(text))
    if objects > _MOST_OBJECTS:
        raise ProductError("eds-too-many-objects", file=str(path), count=objects, limit=_MOST_OBJECTS)
    return text


def _variables(text: str, *, lenient: bool) -> Iterator[ODVariable]:
    try:
        yield from _imported(text)
    except _REFUSED:
        if not lenient:
            raise
        for part in eds_text.by_object(text):
            with contextlib.suppress(*_REFUSED):  # nobody may need it; whoever does is told that it is missing
                yield from _imported(part)


def _imported(text: str) -> list[ODVariable]:
    """All variables of a text, or what `canopen` raises."""
    found = import_eds(io.StringIO(text), 0).values()  # type: ignore[no-untyped-call]
    return [v for item in found for v in ([item] if isinstance(item, ODVariable) else item.subindices.values())]


class _Sections:
    """The file's own words, by object; sub-indices of a compact array stand in the array's section."""

    def __init__(self, text: str, *, strict: bool) -> None:
        self._parser = configparser.RawConfigParser(inline_comment_prefixes=(";",), strict=strict)
        self._parser.read_string(text)
        self._names = {name.lower(): name for name in self._parser.sections()}

    def check(self) -> None:
        """Refuses what is no EDS at all."""
        if "deviceinfo" not in self._names:
            raise ProductError("eds-without-device-info")

    def counts_from_node(self, variable: ODVariable) -> bool:
        """Whether the default is the node id, or that and more."""
        return "$NODEID" in self.word(variable, self.value_option(variable)).upper()

    def value_option(self, variable: ODVariable) -> str:
        """What a device of this file starts with: its configured value in a DCF (CiA 306), else the default."""
        return "ParameterValue" if self.word(variable, "ParameterValue") else "DefaultValue"

    def word(self, variable: ODVariable, option: str) -> str:
        """What the file says; '' when it says nothing."""
        own = f"{variable.index:04x}sub{variable.subindex:x}"
        name = self._names.get(own) or self._names.get(f"{variable.index:04x}", "")
        return self._parser.get(name, option, fallback="").strip()


def _entry(variable: ODVariable, sections: _Sections, text: str) -> ObjectEntry:
    where = address(variable.index, variable.subindex)
    code = variable.data_type or 0
    if code not in TYPES:
        raise ProductError("eds-data-type", object=where, type=code)
    kind = TYPES[code][0]
    option = sections.value_option(variable)
    default: Value | None = variable.value if option == "ParameterValue" else variable.default
    if default is None:
        if sections.word(variable, option) and kind not in ("STRING", "OCTETS", "DOMAIN"):
            raise ProductError("eds-default-not-number", object=where)
        default = text.encode("latin-1") if variable.index == _STORE_EDS else _EMPTY.get(kind, 0)
    return ObjectEntry(
        index=variable.index,
        sub=variable.subindex,
        name=variable.name,
        type=code,
        access=variable.access_type,
        default=default,
        low=_limit(where, sections.word(variable, "LowLimit"), variable.min),
        high=_limit(where, sections.word(variable, "HighLimit"), variable.max),
        mappable=variable.pdo_mappable,
    )


def _limit(where: str, word: str, parsed: float | None) -> float | None:
    """The limit that canopen understood, else the file's own word as a real number."""
    if parsed is not None or not word:
        return parsed
    try:
        limit = float(word)
    except ValueError:
        limit = math.nan
    if not math.isfinite(limit):
        raise ProductError("eds-limit-not-number", object=where, limit=word[:40])
    return limit
