"""Patterns that people give, matched in time linear in the text whatever the pattern (RE2; R. Cox 2007).

RE2 knows neither back references nor look-around. Such a pattern is refused where it is to be used, not where a
document is read: a log's recipes of before stay readable.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import re2

from station.errors import UsageError


def matches_whole(pattern: str, text: str) -> bool:
    """Whether the whole text fits. Errors: UsageError where the pattern is none, or needs what RE2 lacks."""
    return _compiled(pattern).fullmatch(text) is not None


def groups_of(pattern: str, text: str) -> Sequence[str | None] | None:
    """The groups of the first place that fits; None where none does. Errors: UsageError as above."""
    found = _compiled(pattern).search(text)
    return None if found is None else tuple(found.groups())


def named_groups(pattern: str, text: str) -> dict[str, str] | None:
    """The named groups of a pattern that the whole text fits; None where it does not. Errors: UsageError as above."""
    found = _compiled(pattern).fullmatch(text)
    return None if found is None else {k: v for k, v in found.groupdict().items() if v is not None}


@lru_cache(maxsize=64)
def _compiled(pattern: str) -> Any:
    options = re2.Options()
    options.log_errors = False
    try:
        return re2.compile(pattern, options)
    except re2.error as exc:
        why = exc.args[0].decode() if exc.args and isinstance(exc.args[0], bytes) else str(exc)
        raise UsageError("pattern-not-linear", pattern=pattern[:80], why=why) from None
