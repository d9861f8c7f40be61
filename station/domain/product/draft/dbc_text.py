"""A DBC from the PDO mapping of an EDS: where each reading lies is known; what a count of it means is known for the
angles of CiA 410 alone."""

import re
from collections.abc import Mapping

from station.domain.core.types import EXTENDED
from station.domain.product.object_dictionary import ObjectDictionary
from station.domain.product.pdo_check import MappedObject, MappedPdo, mapped_pdos

#: Slopes of one and of both sizes (CiA 410), in units of the resolution, thousandths of a degree.
_SLOPES, _RESOLUTION, _THOUSANDTHS = (0x6010, 0x6020, 0x6110, 0x6120), (0x6000, 0), (1, 10, 100, 1000)
_VALUE_TYPES = {"REAL32": 1, "REAL64": 2}
#: Length that every DBC editor takes.
_LONGEST_NAME = 32


def dbc_text(dictionary: ObjectDictionary, titles: Mapping[int, str]) -> str:
    """The file, '' where the EDS maps nothing to a PDO with an identifier. titles: name of each object by its index."""
    blocks = [_message(pdo, dictionary, titles) for pdo in mapped_pdos(dictionary) if pdo.objects and _is_named(pdo)]
    if not blocks:
        return ""
    types = "\n".join(line for _, line in blocks if line)
    return "\n".join(('VERSION ""', "", "NS_ :", "", "BS_:", "", "BU_: Device", "", *(b for b, _ in blocks), types, ""))


def without_identifier(dictionary: ObjectDictionary) -> tuple[int, ...]:
    """Numbers, from 1, of the TPDOs that map something under an identifier that the EDS leaves open."""
    return tuple(pdo.number + 1 for pdo in mapped_pdos(dictionary) if pdo.objects and not _is_named(pdo))


def _is_named(pdo: MappedPdo) -> bool:
    return pdo.can_id & ~EXTENDED != 0


def _message(pdo: MappedPdo, dictionary: ObjectDictionary, titles: Mapping[int, str]) -> tuple[str, str]:
    """The message with its signals, and the lines that say which of them are floats."""
    length = -(-pdo.objects[-1].end_bit // 8)
    lines, types = [f"BO_ {pdo.can_id} TPDO{pdo.number + 1}: {length} Device"], []
    names = dict[str, int]()
    for mapped in pdo.objects:
        name = _name(mapped, dictionary, titles)
        names[name] = names.get(name, 0) + 1
        name += f"_{names[name]}" if names[name] > 1 else ""
        sign = "-" if mapped.type_name.startswith(("INT", "REAL")) else "+"
        factor, unit = _meaning(mapped, dictionary)
        lines.append(
            f' SG_ {name} : {mapped.first_bit}|{mapped.length}@1{sign} ({factor},0) [0|0] "{unit}" Vector__XXX'
        )
        if mapped.type_name in _VALUE_TYPES:
            types.append(f"SIG_VALTYPE_ {pdo.can_id} {name} : {_VALUE_TYPES[mapped.type_name]};")
    return "\n".join((*lines, "")), "\n".join(types)


def _name(mapped: MappedObject, dictionary: ObjectDictionary, titles: Mapping[int, str]) -> str:
    index, sub = mapped.at
    entry = dictionary.entries.get(mapped.at)
    title, own = titles.get(index, f"Object_{index:04X}"), entry.name if entry is not None and sub else ""
    words = own if title.lower() in own.lower() else f"{title} {own}"
    plain = re.sub(r"\W+", "_", words, flags=re.ASCII).strip("_")[-_LONGEST_NAME:].strip("_")
    return plain if plain[:1].isalpha() else f"Object_{index:04X}_{sub}"


def _meaning(mapped: MappedObject, dictionary: ObjectDictionary) -> tuple[str, str]:
    """Factor and unit as the DBC writes them."""
    resolution = dictionary.entries.get(_RESOLUTION)
    if mapped.at[0] in _SLOPES and resolution is not None and resolution.default in _THOUSANDTHS:
        return f"{float(resolution.default) / 1000:g}", "deg"
    return "1", ""
