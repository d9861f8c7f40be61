"""JSON of a file that anybody may have written: whatever is wrong with it is a ValueError."""

import json
import math
from pathlib import Path
from typing import Any, Final

from station.files.ordinary import read_ordinary
from station.messages import Message, system_reason

#: What taking an unknown document apart may raise: another shape than expected.
NOT_AS_EXPECTED: Final = (ValueError, LookupError, TypeError, AttributeError, OverflowError)
#: No file by which processes of the station find each other is longer: a hundred nests' live state takes a tenth.
MOST_BYTES: Final = 4_000_000


def read_json(path: Path, most_bytes: int = MOST_BYTES) -> Any:
    """The value in a file that anybody may have put there: a pipe in its place is not waited for, and nothing longer is
    read. Errors: OSError; ValueError as parse_json."""
    return parse_json(read_ordinary(path, most_bytes))


def parse_json(text: str | bytes, *, finite: bool = True) -> Any:
    """The value. finite: every number is. Errors: ValueError, also for what is nested deeper than Python's stack or
    counts beyond its digits."""
    try:
        if finite:
            return json.loads(text, parse_float=_finite, parse_constant=_finite)
        return json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def unread_reason(error: Exception) -> Message:
    """Why a document was not what it should be, for one of OSError and NOT_AS_EXPECTED."""
    if isinstance(error, OSError):
        return system_reason(error)
    if isinstance(error, json.JSONDecodeError):
        return Message("json-syntax", line=error.lineno, column=error.colno)
    return Message("json-other-layout")


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:20]} is no finite number")
    return number
