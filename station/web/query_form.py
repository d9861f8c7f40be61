"""Questions of the audit and chart pages, as they stand in an address → a query on the log."""

from collections.abc import Mapping

from station.domain.core.types import Outcome
from station.errors import UsageError
from station.ports.log_reader import Query, serial_filter
from station.service import time_text
from station.web.guard import parse_whole_number

#: Fields of the form that are columns of the query as they stand.
COLUMN_FIELDS = (
    "station",
    "nest",
    "recipe_name",
    "recipe_hash",
    "firmware",
    "lot",
    "operator",
    "software",
    "fixture",
    "check",
    "reference",
)
#: All of them, in the order in which a person thinks of them.
QUERY_FIELDS = (
    *("serial", "since", "until", "outcome", "check", "recipe_name", "recipe_version"),
    *("station", "nest", "fixture", "operator", "lot", "firmware", "software", "reference", "recipe_hash"),
)


def query_of(parameters: Mapping[str, str]) -> Query:
    """The query; empty fields do not matter. In a serial, * stands for any text and ? for any character.
    Errors: UsageError."""
    given = {k: parameters[k].strip() for k in QUERY_FIELDS if parameters.get(k, "").strip()}
    since_ns, until_ns = _time_ns(given.get("since"), next_day=False), _time_ns(given.get("until"), next_day=True)
    if since_ns is not None and until_ns is not None and since_ns > until_ns:
        raise UsageError("span-reversed", since=given["since"][:40], until=given["until"][:40])
    return Query(
        **serial_filter(given.get("serial")),
        recipe_version=whole_number(given.get("recipe_version", "")),
        outcome=_outcome(given.get("outcome")),
        since_ns=since_ns,
        until_ns=until_ns,
        before=whole_number(parameters.get("before", "")),
        **{k: given[k] for k in COLUMN_FIELDS if k in given},
    )


def whole_number(text: str) -> int | None:
    """The number in a field; None where it is empty. A field that is not understood must not be one that is not asked.
    Errors: UsageError."""
    number = parse_whole_number(text.strip())
    if number is None and text.strip():
        raise UsageError("page-not-a-number", text=text[:40])
    return number


def _outcome(text: str | None) -> str | None:
    if text is None:
        return None
    if text.upper() not in tuple(Outcome):
        raise UsageError("outcome-unknown", text=text[:40], outcomes=tuple(Outcome))
    return text.upper()


def _time_ns(text: str | None, *, next_day: bool) -> int | None:
    """A day or an instant, local; a day as the end of a span counts whole."""
    if text is None:
        return None
    try:
        return time_text.parse_ns(text, end=next_day)
    except (time_text.NoTime, OverflowError) as exc:
        raise UsageError("page-not-a-time", text=text[:40]) from exc
