"""A DBC file → pure layouts. cantools parses it once; rules it lacks are ours; decoding is elsewhere."""

import logging
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from station.domain.can.dbc_rules import DbcIssue, lint
from station.domain.can.signals import FrameLayout, SignalLayout
from station.domain.core.types import EXTENDED
from station.errors import ProductError
from station.messages import Message, system_reason

#: Beyond this a file is not one product's DBC but an accident, and parsing it takes longer than anybody waits.
MOST_BYTES = 4_000_000
#: A page of mistakes helps nobody; the rest shows after these are mended.
MOST_FINDINGS = 10
# cantools warns of double names in its log; here they are errors, reported once.
logging.getLogger("cantools").addHandler(logging.NullHandler())
_STARTS = re.compile(r"^\s*(?:BO_\s+\d+\s+(?P<message>\w+)|SG_\s+(?P<signal>\w+))", re.MULTILINE)
_AT_LINE = re.compile(r"at line (\d+)")


def read_layouts(path: Path) -> Mapping[str, FrameLayout]:
    """All messages of a DBC by name, in the order of the file.

    Errors: ProductError with file, line, message, signal and remedy of each mistake.
    """
    text = _text(path)
    layouts = [_frame(m) for m in _messages(path, text)]
    issues = lint(layouts)
    if issues:
        reasons = [_issue_message(text, issue) for issue in issues[:MOST_FINDINGS]]
        if len(issues) > MOST_FINDINGS:
            reasons.append(Message("more-mistakes", count=len(issues) - MOST_FINDINGS))
        raise ProductError("document-mistakes", file=str(path), mistakes=reasons)
    return {layout.name: layout for layout in layouts}


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


def _messages(path: Path, text: str) -> list[Any]:
    from cantools import database  # heavy, and only needed where a product is loaded
    from cantools.database.errors import Error

    try:
        parsed: Any = database.load_string(text, "dbc", strict=True, sort_signals=None)
    except Error as error:
        raise ProductError(_syntax_error(path, text, str(getattr(error, "e_dbc", error)))) from None
    return list(parsed.messages)


def _syntax_error(path: Path, text: str, why: str) -> Message:
    """cantools' complaint as a message with a line."""
    at = _AT_LINE.search(why)
    if at is not None:
        return Message("line-of-file", file=str(path), line=int(at[1]), reason=Message("dbc-syntax", why=why))
    named = [m for m in _STARTS.finditer(text) if m["message"] and re.search(rf"\b{re.escape(m['message'])}\b", why)]
    reason = Message("dbc-refused", why=why.rstrip("."))
    if not named:
        return Message("document-mistakes", file=str(path), mistakes=[reason])
    return Message("line-of-file", file=str(path), line=_line(text, named[0].start("message")), reason=reason)


def _frame(message: Any) -> FrameLayout:
    can_id = message.frame_id | (EXTENDED if message.is_extended_frame else 0)
    return FrameLayout(message.name, can_id, message.length, tuple(_signal(s) for s in message.signals))


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
    return line


def _line(text: str, offset: int) -> int:
    return text.count("\n", 0, offset) + 1
