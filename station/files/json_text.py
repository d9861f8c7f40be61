"""JSON of a file that anybody may have written: whatever is wrong with it is a ValueError."""

import json
import math
from typing import Any, Final

#: What taking an unknown document apart may raise: another shape than expected.
NOT_AS_EXPECTED: Final = (ValueError, KeyError, TypeError, AttributeError)


def parse_json(text: str | bytes, *, finite: bool = True) -> Any:
    """The value. finite: every number is. Errors: ValueError, also for what is nested deeper than Python's stack or
    counts beyond its digits."""
    try:
        if finite:
            return json.loads(text, parse_float=_finite, parse_constant=_finite)
        return json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:20]} is no finite number")
    return number
