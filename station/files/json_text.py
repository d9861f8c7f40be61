"""JSON of a file that anybody may have written: whatever is wrong with it is a ValueError."""

import json
from typing import Any


def parse_json(text: str | bytes) -> Any:
    """The value. Errors: ValueError, also for what is nested deeper than Python's stack or counts beyond its digits."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
