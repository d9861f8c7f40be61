"""Which language a person reads, and what they read in it."""

import re
from collections.abc import Mapping
from typing import Any

from starlette.requests import Request

from station.messages import Message, render
from station.messages.labels import all_texts
from station.reporting.words import Words, words_of

LANGUAGE_COOKIE = "station_language"
#: A hyphen before a number is a minus; one within a name or an option is not.
_MINUS = re.compile(r"(?<![\w-])-(?=[\d.])")


def words(code: str) -> Words:
    """Words of that language."""
    return words_of(code)


def sentence(message: Message | Mapping[str, Any] | str | None, code: str) -> str:
    """A message, or what a document keeps of one, in that language; an older log's sentence as it was kept."""
    if message is None:
        return ""
    if isinstance(message, Mapping):
        message = Message.of(message)
    return message if isinstance(message, str) else _MINUS.sub("−", render(message, code))


def of_request(request: Request) -> str:
    """The language asked for by link, remembered by cookie, or wished by the browser; English otherwise."""
    known = all_texts()
    wished = [request.query_params.get("language", ""), request.cookies.get(LANGUAGE_COOKIE, "")]
    wished += [
        part.partition(";")[0].strip()[:2].lower() for part in request.headers.get("accept-language", "").split(",")
    ]
    return next((code for code in wished if code in known), "en")
