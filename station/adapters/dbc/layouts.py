"""A file that describes frames → pure layouts. cantools parses it once; rules it lacks are ours; decoding is
elsewhere."""

import logging
import math
import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from station.adapters.dbc import other_formats
from station.adapters.dbc.repair import MOST_REPAIRS, without_fault
from station.domain.can.dbc_rules import DbcIssue, lint
from station.domain.can.signals import FrameLayout, SignalLayout
from station.domain.core.types import EXTENDED
from station.errors import ProductError
from station.messages import Message, system_reason
from station.optional_imports import hide_packages

#: Beyond this a file is not one product's DBC but an accident, and parsing it takes longer than anybody waits.
MOST_BYTES = 4_000_000
#: Nodes, messages and signals together: those of a whole car come to some ten thousand.
MOST_DEFINITIONS = 25_000
#: Characters that repairs may have parsed anew in all, and repairs that every file gets.
MOST_REPARSED, LEAST_REPAIRS = 8_000_000, 4
#: A page of mistakes helps nobody; the rest shows after these are mended.
MOST_FINDINGS = 10
# cantools warns of double names in its log; here they are errors, reported once.
logging.getLogger("cantools").addHandler(logging.NullHandler())
_DEFINITIONS = re.compile(r"^[ \t]*(?:BO_|SG_)\s", re.MULTILINE)
_NODES = re.compile(r"^[ \t]*BU_[ \t]*:([\w\s]*)", re.MULTILINE)
_MESSAGES = re.compile(r"^[ \t]*BO_\s", re.MULTILINE)
_STARTS = re.compile(r"^\s*(?:BO_\s+\d+\s+(?P<message>\w+)|SG_\s+(?P<signal>\w+))", re.MULTILINE)
#: A complaint without a word of DBC comes from the inside of the parser.
_ABOUT_A_DBC = re.compile(r"[A-Z]{2,}|\b(message|signal|value|frame|node|unused|choice)s?\b")
#: What the parser puts into a line to show the place, whose column it names anyway.
_HERE = ">>!<<"
_AT_LINE = re.compile(r"at line (\d+)")
#: What Python says of a text that is no number of the kind asked for.
_NO_NUMBER = re.compile(r"(?:invalid literal for int\(\)|could not convert string to float)[^']*'(?P<text>[^']+)'")


#: Signals that somebody needs, by message.
Used = Mapping[str, Collection[str]]


def read_layouts(path: Path, used: Used | None = None) -> Mapping[str, FrameLayout]:
    """All messages of a DBC, KCD, SYM or ARXML by name, in the order of the file.

    used: only these are checked, and what the parser refuses elsewhere is left out; None: everything is checked.
    Errors: ProductError with file, line, message, signal and remedy of each mistake.
    """
    text = _text(path)
    other = path.suffix.lower() in other_formats.FORMATS
    if (count := _definitions(text, other=other)) > MOST_DEFINITIONS:
        raise ProductError("dbc-too-many-definitions", file=str(path), count=count, limit=MOST_DEFINITIONS)
    messages = other_formats.read_messages(path, text, used) if other else _messages(path, text, used)
    layouts = [_frame(m, used) for m in messages]
    issues = lint(layouts, used)
    if issues:
        reasons = [_issue_message(text, issue) for issue in issues[:MOST_FINDINGS]]
        if len(issues) > MOST_FINDINGS:
            reasons.append(Message("more-mistakes", count=len(issues) - MOST_FINDINGS))
        raise ProductError("document-mistakes", file=str(path), mistakes=reasons)
    return {layout.name: layout for layout in layouts}


def _definitions(text: str, *, other: bool) -> int:
    if other:
        return sum(1 for _ in other_formats.DEFINITIONS.finditer(text))
    return sum(1 for _ in _DEFINITIONS.finditer(text)) + sum(len(m[1].split()) for m in _NODES.finditer(text))


def _text(path: Path) -> str:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise ProductError("file-too-long", file=str(path), limit=MOST_BYTES)
        content = path.read_bytes()
    except OSError as error:
        raise ProductError("file-unreadable", file=str(path), why=system_reason(error)) from None
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")  # what most DBC editors write


def _messages(path: Path, text: str, used: Used | None) -> list[Any]:
    with hide_packages("asammdf"):  # cantools imports python-can
        from cantools import database  # heavy, and only needed where a product is loaded
        from cantools.database.errors import Error

    remaining: str | None = text
    for _ in range(min(MOST_REPAIRS, max(LEAST_REPAIRS, MOST_REPARSED // max(len(text), 1)))):
        try:
            parsed: Any = database.load_string(remaining or "", "dbc", strict=used is None, sort_signals=None)
            for message in parsed.messages:
                if used is not None and message.name in used:
                    message.refresh(strict=True)
            return list(parsed.messages)
        except Error as error:
            if not _MESSAGES.search(text):
                raise ProductError("dbc-no-message", file=str(path)) from None
            why = str(getattr(error, "e_dbc", error)).replace(_HERE, "")
            remaining = None if used is None or remaining is None else without_fault(remaining, why, used.keys())
            if remaining is None:
                raise ProductError(_syntax_error(path, text, why)) from None
    raise ProductError(_syntax_error(path, text, why))


def _syntax_error(path: Path, text: str, why: str) -> Message:
    """cantools' complaint as a message with a line."""
    at = _AT_LINE.search(why)
    if at is not None:
        return Message("line-of-file", file=str(path), line=int(at[1]), reason=Message("dbc-syntax", why=why))
    if (number := _NO_NUMBER.search(why)) is not None and number["text"] in text:
        line = _line(text, text.index(number["text"]))
        return Message("line-of-file", file=str(path), line=line, reason=Message("dbc-number", text=number["text"]))
    named = [m for m in _STARTS.finditer(text) if m["message"] and re.search(rf"\b{re.escape(m['message'])}\b", why)]
    reason = Message("dbc-refused", why="; ".join(line.strip() for line in why.rstrip(".").splitlines()))
    if not named:
        if not _ABOUT_A_DBC.search(why):
            reason = Message("dbc-parser-gave-up", why=why)
        return Message("document-mistakes", file=str(path), mistakes=[reason])
    return Message("line-of-file", file=str(path), line=_line(text, named[0].start("message")), reason=reason)


def _frame(message: Any, used: Used | None) -> FrameLayout:
    can_id = message.frame_id | (EXTENDED if message.is_extended_frame else 0)
    signals = [_signal(s) for s in message.signals]
    if used is not None and message.name not in used:
        signals = [s for s in signals if _decodes(s, message.length)]
    return FrameLayout(message.name, can_id, message.length, tuple(signals))


def _decodes(signal: SignalLayout, length: int) -> bool:
    """Whether a signal that nobody has checked lies within its message and has a size that numbers have."""
    sizes = (16, 32, 64) if signal.is_float else range(1, 65)
    inside = signal.first_bit + signal.length <= 8 * length
    return signal.length in sizes and inside and math.isfinite(signal.scale) and math.isfinite(signal.offset)


def _signal(signal: Any) -> SignalLayout:
    return SignalLayout(
        name=signal.name,
        start=signal.start,
        length=signal.length,
        big_endian=signal.byte_order == "big_endian",
        signed=signal.is_signed,
        is_float=signal.conversion.is_float,
        scale=_number(signal.conversion.scale),
        offset=_number(signal.conversion.offset),
        minimum=None if signal.minimum is None else _number(signal.minimum),
        maximum=None if signal.maximum is None else _number(signal.maximum),
        unit=signal.unit or "",
        selector=signal.multiplexer_signal,
        selected_by=tuple(signal.multiplexer_ids or ()),
    )


def _number(value: float) -> int | float:
    """An integer beyond every float is as good as endless, and the rules refuse it."""
    try:
        float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf
    return value


def _issue_message(text: str, issue: DbcIssue) -> Message:
    name = issue.message if issue.signal is None else f"{issue.message}.{issue.signal}"
    return Message("dbc-issue", line=_line_of(text, issue), name=name, reason=issue.mistake)


def _line_of(text: str, issue: DbcIssue) -> int:
    """The line of a message or signal; of two with one name the second."""
    message, line = "", 1
    for start in _STARTS.finditer(text):
        if start["message"] is not None:
            message = start["message"]
        if message == issue.message and start["signal"] == issue.signal:
            line = _line(text, start.end())
    if not message:  # not a DBC: where the name is met first
        named = re.search(rf"\b{re.escape(issue.signal or issue.message)}\b", text)
        line = line if named is None else _line(text, named.start())
    return line


def _line(text: str, offset: int) -> int:
    return text.count("\n", 0, offset) + 1
