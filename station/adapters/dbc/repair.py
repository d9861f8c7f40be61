"""Statements of a DBC that its parser refuses and nobody needs are blanked: the rest of the file can be read."""

import re
from collections.abc import Collection

from station.domain.core.types import EXTENDED

#: Statements blanked in one file before it is given up.
MOST_REPAIRS = 60
_AT_LINE = re.compile(r"at line (\d+)")
#: A value table or a type of a signal that is not there, as the complaint lists it.
_UNUSED = re.compile(r"^\s*(VAL_|SIG_VALTYPE_) (\d+) (\w+)", re.MULTILINE)
_MESSAGE = re.compile(r"^\s*BO_\s+(\d+)\s+(\S+?)\s*:")
#: The largest identifier of 11 bits.
_MOST_STANDARD = 0x7FF
#: An attribute's definition, its default, or its value somewhere.
_ATTRIBUTE = re.compile(r'^\s*BA_(?:DEF_(?:DEF_)?(?:REL_)?|REL_)?\s+(?:[A-Z_]+\s+)?"(\w+)"')
_KEYWORD = re.compile(r"^\s*(?:BO_|SG_|CM_|BA_|VAL_|BA_DEF|SIG_|EV_|BU_|ENVVAR|SGTYPE|BO_TX|NS_|BS_|VERSION)")


def without_fault(text: str, why: str, used: Collection[str]) -> str | None:
    """The text without what a parser's complaint names, line numbers as before; None where that is not found, or is
    of a message in `used`."""
    lines = text.split("\n")
    if unused := _UNUSED.findall(why):
        pattern = re.compile("|".join(rf"^\s*{keyword}\s+{number}\s+{signal}\b" for keyword, number, signal in unused))
        rows = {row for i, line in enumerate(lines) if pattern.match(line) for row in _statement(lines, i)}
        return _blanked(lines, rows)
    at = _AT_LINE.search(why)
    if at is not None:
        return _blanked(lines, _of_line(lines, int(at[1]) - 1, used))
    named = [i for i, line in enumerate(lines) if (m := _MESSAGE.match(line)) and _ends_with(why, m[2])]
    if not named or _name(lines[named[0]]) in used:
        return None
    if "more than 11 bits" in why:  # the flag of 29-bit identifiers is missing: who forgets one forgets them all
        return "\n".join(line if _name(line) in used else _extended(line) for line in lines)
    return _blanked(lines, {row for i in named for row in _block(lines, i)})


def _extended(line: str) -> str:
    """A message with the flag of a 29-bit identifier where it needs one; any other line as it is."""
    message = _MESSAGE.match(line)
    if message is None or not _MOST_STANDARD < int(message[1]) < EXTENDED:
        return line
    return line.replace(message[1], str(int(message[1]) & 0x1FFF_FFFF | EXTENDED), 1)


def _ends_with(why: str, name: str) -> bool:
    return re.search(rf"\bmessage {re.escape(name)}\b", why) is not None


def _name(line: str) -> str:
    found = _MESSAGE.match(line)
    return "" if found is None else found[2]


def _of_line(lines: list[str], row: int, used: Collection[str]) -> set[int]:
    """Rows of the statement at a row; of a signal or message that is used none."""
    if not 0 <= row < len(lines):
        return set()
    while row > 0 and not _KEYWORD.match(lines[row]):
        row -= 1
    if lines[row].lstrip().startswith("SG_"):
        begin = row
        while begin > 0 and not lines[begin].lstrip().startswith("BO_ "):
            begin -= 1
        return set() if _name(lines[begin]) in used else {row}
    if lines[row].lstrip().startswith("BO_ "):
        return set() if _name(lines[row]) in used else set(_block(lines, row))
    if (
        attribute := _ATTRIBUTE.match(lines[row])
    ) is not None:  # what is wrong with one value is wrong with all of them
        same = [i for i, line in enumerate(lines) if (m := _ATTRIBUTE.match(line)) and m[1] == attribute[1]]
        return {j for i in same for j in _statement(lines, i)}
    if not _KEYWORD.match(lines[row]):  # a comment of C, or whatever else stands before the first statement
        return set(range(next((i for i, line in enumerate(lines) if _KEYWORD.match(line)), 0)))
    return set(_statement(lines, row))


def _block(lines: list[str], row: int) -> range:
    """A message with its signals."""
    end = row + 1
    while end < len(lines) and lines[end].lstrip().startswith("SG_"):
        end += 1
    return range(row, end)


def _statement(lines: list[str], row: int) -> range:
    """A statement up to its semicolon; one that has none is its line."""
    end = row
    while end < min(row + 200, len(lines)) and not lines[end].rstrip().endswith(";"):
        if end > row and _KEYWORD.match(lines[end]):
            return range(row, row + 1)
        end += 1
    return range(row, end + 1)


def _blanked(lines: list[str], rows: set[int]) -> str | None:
    cleared = [i for i in rows if i < len(lines) and lines[i].strip()]
    return "\n".join("" if i in rows else line for i, line in enumerate(lines)) if cleared else None
