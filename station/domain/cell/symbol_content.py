"""What a label's symbol says → the serial number of the unit. Pure.

Forms: plain text, a pattern, GS1 element strings (GS1 General Specifications, 7.8: FNC1 arrives as GS), and ISO/IEC
15434 messages of format 06 (data identifiers of ANSI MH10.8.2).
"""

import re
from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from station.domain.core.patterns import named_groups
from station.domain.recipe.fields import StrictModel
from station.errors import InvalidValue, UsageError
from station.messages import Message

GS, RS, EOT = "\x1d", "\x1e", "\x04"
#: AIM symbology identifiers (ISO/IEC 15424) that scanners put in front: `]d2` a DataMatrix with FNC1, `]Q3` …
_IDENTIFIER = re.compile(r"^\][A-Za-z][0-9A-Za-z]")
#: Longer is no label of a unit.
MOST_CHARACTERS = 1000
#: GS1 identifiers of a fixed length by their first two digits: digits of the identifier, and length with its value.
_GS1_FIXED = (
    {"00": (2, 20), "01": (2, 16), "02": (2, 16), "03": (2, 16), "04": (2, 18), "20": (2, 4), "41": (3, 16)}
    | {str(n): (2, 8) for n in range(11, 20)}
    | {str(n): (4, 10) for n in range(31, 37)}
)
#: The others end with a separator: digits of the identifier.
_GS1_OPEN = {"10": 2, "21": 2, "22": 2, "30": 2, "37": 2, "24": 3, "25": 3, "40": 3, "71": 3, "70": 4, "80": 4} | {
    str(n): 2 for n in range(90, 100)
}


class ContentRules(StrictModel):
    """What a label holds. form: plain | pattern | gs1 | iso15434; serial: the identifier of the serial (`21`, `S`), or
    the group of the pattern; require: other identifiers and what they must say (a part number, say)."""

    form: Literal["plain", "pattern", "gs1", "iso15434"] = "plain"
    pattern: Annotated[str, Field(max_length=200)] = ""
    serial: Annotated[str, Field(max_length=8)] = ""
    require: dict[Annotated[str, Field(max_length=8)], Annotated[str, Field(max_length=64)]] = Field(
        default_factory=dict
    )

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.form == "pattern":
            try:
                groups = re.compile(self.pattern).groupindex
            except re.error as exc:
                raise InvalidValue("label-pattern-wrong", pattern=self.pattern, why=str(exc)) from None
            if "serial" not in groups:
                raise InvalidValue("label-pattern-without-serial", pattern=self.pattern)
        return self

    @property
    def identifier(self) -> str:
        """The identifier that bears the serial."""
        return self.serial or {"gs1": "21", "iso15434": "S"}.get(self.form, "serial")


def serial_of_symbol(text: str, rules: ContentRules) -> str:
    """The serial that a symbol bears. Errors: UsageError with what is wrong with the label."""
    shown = _IDENTIFIER.sub("", text.strip("\r\n\t "))
    if not shown or len(shown) > MOST_CHARACTERS:
        raise UsageError(Message("label-too-long" if shown else "label-empty", limit=MOST_CHARACTERS))
    if rules.form == "plain":
        return shown
    fields = fields_of(shown, rules)
    for identifier, wanted in rules.require.items():
        if fields.get(identifier) != wanted:
            found = fields.get(identifier, "")
            raise UsageError("label-other-field", identifier=identifier, found=found[:40], wanted=wanted)
    serial = fields.get(rules.identifier, "")
    if not serial:
        raise UsageError("label-without-serial", identifier=rules.identifier, text=printable(shown))
    return serial


def fields_of(text: str, rules: ContentRules) -> Mapping[str, str]:
    """Identifier → value. Errors: UsageError where the text is not of that form."""
    if rules.form == "pattern":
        found = named_groups(rules.pattern, text)
        if found is None:
            raise UsageError("label-not-of-pattern", text=printable(text), pattern=rules.pattern)
        return found
    return _gs1(text) if rules.form == "gs1" else _iso15434(text)


def printable(text: str) -> str:
    """The beginning of a label as people read it."""
    return "".join(c if c.isprintable() else "·" for c in text)[:60]


def _gs1(text: str) -> dict[str, str]:
    found: dict[str, str] = {}
    rest = text.lstrip(GS)
    while rest:
        size, length = _GS1_FIXED.get(rest[:2], (_GS1_OPEN.get(rest[:2], 0), 0))
        if not size or len(rest) <= size or (length and len(rest) < length):
            raise UsageError("label-not-gs1", text=printable(text), rest=printable(rest))
        identifier = rest[:size]
        value, rest = (rest[size:length], rest[length:]) if length else _until_separator(rest[size:])
        found[identifier] = value
        rest = rest.lstrip(GS)
    return found


def _until_separator(rest: str) -> tuple[str, str]:
    value, _, after = rest.partition(GS)
    return value, after


def _iso15434(text: str) -> dict[str, str]:
    """`[)>` RS `06` GS fields separated by GS, RS EOT. A data identifier is digits and one letter."""
    if not text.startswith("[)>" + RS + "06" + GS):
        raise UsageError("label-not-iso15434", text=printable(text))
    body = text[len("[)>" + RS + "06" + GS) :].rstrip(EOT).rstrip(RS)
    found: dict[str, str] = {}
    for field in filter(None, body.split(GS)):
        match = re.match(r"(\d{0,3}[A-Z])(.+)", field, re.DOTALL)
        if match is None:
            raise UsageError("label-not-iso15434", text=printable(text))
        found[match[1]] = match[2]
    return found
