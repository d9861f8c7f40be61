"""Which objects of an EDS may keep a calibration, and what else a device map names."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from station.domain.product.device_map import CELLS
from station.domain.product.object_dictionary import ObjectDictionary, ObjectEntry

#: CiA 301: the identity object, the commands that store and restore, the date of the configuration.
IDENTITY, STORE, RESTORE, CONFIGURATION = 0x1018, 0x1010, 0x1011, 0x1020
#: The manufacturer's and the device profiles' objects; those of communication keep no calibration.
FIRST_OWN = 0x2000
_CALIBRATION = r"cal(?![a-z])|calib|correct|compens|coeff|matrix"
_MATRIX = re.compile(r"matrix|gain|scale(?! ?range)|sensitiv|slope|misalign|cross", re.IGNORECASE)
OFFSET = re.compile(r"offset|bias|zero", re.IGNORECASE)
_WORD = re.compile(_CALIBRATION, re.IGNORECASE)
_NOT_STORED = re.compile(r"reading|measur|actual|raw|output|position|velocity|velo|current|torque|home", re.IGNORECASE)
_SINGLE: Mapping[str, re.Pattern[str]] = {
    "output": re.compile(r"output (mode|select|switch)|(compensat|correct|calib)\w* (on|enable|active|output)", re.I),
    "unlock": re.compile(r"unlock|access (key|code)|password|calibration (key|code)", re.I),
    "valid": re.compile(r"(calib\w*|coeff\w*) valid|valid flag", re.I),
    "checksum": re.compile(r"(check ?sum|crc).*(coeff|calib)|(coeff|calib)\w* (check ?sum|crc)", re.I),
    "temperature": re.compile(r"calib\w* temperature|temperature of calib|reference temperature", re.I),
    "record": re.compile(r"calib\w* (record|id|certificate)|certificate", re.I),
}
#: Types that numbers are kept in.
NUMBERS = ("INT8", "INT16", "INT32", "REAL32", "REAL64", "UINT8", "UINT16", "UINT32")
_NINE, _THREE = 9, 3


@dataclass(frozen=True, slots=True)
class BlockObjects:
    """Objects that may keep coefficients: entries by cell (`xy` or `x`), in the order of their sub-indices."""

    title: str
    cells: Mapping[str, ObjectEntry]

    @property
    def first(self) -> ObjectEntry:
        """The first coefficient's object."""
        return next(iter(self.cells.values()))


@dataclass(frozen=True, slots=True)
class MapObjects:
    """What the EDS offers. matrix, offset: None where nothing looks like it, matrix also where no offset does; single:
    objects by key of the map."""

    matrix: BlockObjects | None
    offset: BlockObjects | None
    single: Mapping[str, ObjectEntry] = field(default_factory=dict)


def find(dictionary: ObjectDictionary, titles: Mapping[int, str]) -> MapObjects:
    """The likeliest objects. titles: name of each object by its index."""
    blocks = list(_blocks(dictionary, titles))
    matrix = _best(blocks, _MATRIX, (_NINE, _THREE))
    offset = _best([b for b in blocks if b is not matrix], OFFSET, (_THREE,))
    own = [e for e in dictionary.entries.values() if e.index >= FIRST_OWN]
    single = dict[str, ObjectEntry]()
    for key, pattern in _SINGLE.items():
        found = (e for e in own if e.sub == 0 and _fits(key, e) and pattern.search(titles.get(e.index, e.name)))
        if (entry := next(found, None)) is not None:
            single[key] = entry
    return MapObjects(matrix if offset else None, offset, single)


def _fits(key: str, entry: ObjectEntry) -> bool:
    if key == "record":
        return entry.type_name == "STRING" and entry.writable
    if key == "checksum":
        return entry.type_name == "UINT32" and entry.readable
    if key == "unlock":
        return entry.writable and entry.type_name.startswith("UINT")
    return entry.writable and entry.type_name in NUMBERS


def _blocks(dictionary: ObjectDictionary, titles: Mapping[int, str]) -> Iterator[BlockObjects]:
    """Three or nine numbers of one type that may be written, in one object."""
    by_index: dict[int, list[ObjectEntry]] = {}
    for (index, sub), entry in sorted(dictionary.entries.items()):
        if index >= FIRST_OWN and sub > 0 and entry.writable and entry.type_name in NUMBERS:
            by_index.setdefault(index, []).append(entry)
    for index, entries in by_index.items():
        if len(entries) in (_NINE, _THREE) and len({e.type for e in entries}) == 1:
            names = CELLS if len(entries) == _NINE else ("x", "y", "z")
            yield BlockObjects(titles.get(index, ""), dict(zip(names, entries, strict=True)))


def _best(blocks: list[BlockObjects], pattern: re.Pattern[str], sizes: tuple[int, ...]) -> BlockObjects | None:
    """The block whose names say most; None where none says anything."""

    def score(block: BlockObjects) -> int:
        text = " ".join([block.title, *(e.name for e in block.cells.values())])
        if not pattern.search(text) or _NOT_STORED.search(block.title):
            return 0
        return 2 + 2 * bool(_WORD.search(text)) + (len(block.cells) == _NINE)

    ranked = sorted((b for b in blocks if len(b.cells) in sizes and score(b)), key=score, reverse=True)
    return ranked[0] if ranked else None
