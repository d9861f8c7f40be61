"""A reader's language, as what is drawn and certified needs it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from station.messages import labels


@dataclass(frozen=True, slots=True)
class Words:
    """code: the language; texts: its labels by key; say: a sentence of the station in it."""

    code: str
    texts: Mapping[str, str]
    say: Callable[[str], str]


def words_of(code: str, say: Callable[[str], str] = str) -> Words:
    """Words of that language."""
    return Words(code, labels.all_texts()[code], say)
