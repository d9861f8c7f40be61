"""EDS and DCF texts as editors write them → texts that a strict parser reads: nothing of an object is changed."""

import configparser
import re
from collections.abc import Iterator

_SECTION = re.compile(r"^\s*\[([^\]]+)\]")
_OPTION = re.compile(r"^\s*[^=\[\];#]+=")
_OBJECT = re.compile(r"^([0-9A-Fa-f]{4})(?:sub[0-9A-Fa-f]+|name|value)?$", re.IGNORECASE)
#: Sections that say nothing of an object, and whose counts are often wrong.
_NEEDLESS = ("comments", "fileinfo", "devicecomissioning", "devicecommissioning", "dummyusage")


def cleaned(text: str) -> str:
    """The text without stray lines, comments, sections that no object needs, and empty values of the device block."""
    cleaned_lines: list[str] = []
    section = ""
    for line in text.splitlines():
        head = _SECTION.match(line)
        if head is not None:
            section = head[1].strip().lower()
        elif not _OPTION.match(line) or (section == "deviceinfo" and not _plain(line)):
            continue
        if section and section not in _NEEDLESS:
            cleaned_lines.append(line.strip() if head is None else f"[{head[1].strip()}]")
    return "\n".join(cleaned_lines) + "\n"


def _plain(line: str) -> bool:
    """Whether an option has a value that is a number or a text that may stay."""
    name, _, value = line.partition("=")
    number = value.partition(";")[0].strip()
    if name.strip().lower() in ("vendorname", "productname", "ordercode"):
        return True
    try:
        int(number, 0)
    except ValueError:
        return False
    return True


def by_object(text: str) -> Iterator[str]:
    """A text for each object alone, so that one which is refused does not take the others with it."""
    parser = configparser.RawConfigParser(inline_comment_prefixes=(";",), strict=False)
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    parser.read_string(text)
    groups: dict[str, list[str]] = {}
    for section in parser.sections():
        if found := _OBJECT.match(section):
            groups.setdefault(found[1].upper(), []).append(section)
    for sections in groups.values():
        lines = [
            line for section in sections for line in (f"[{section}]", *(f"{k}={v}" for k, v in parser.items(section)))
        ]
        yield "\n".join(["[DeviceInfo]", *lines]) + "\n"
