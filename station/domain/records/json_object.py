"""JSON in a record that anybody may have written."""

import json
from typing import Any


def json_object(text: str) -> dict[str, Any]:
    """The object. Errors: ValueError for everything else, also for what is nested deeper than Python's stack."""
    try:
        found = json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    if not isinstance(found, dict):
        raise ValueError("it is no object")
    return found
