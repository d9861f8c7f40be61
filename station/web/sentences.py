"""Sentences of the station in the reader's language. The station speaks English; a sentence that stands in the log or
comes from a run is recognised by the words around its values, and said again with the same values.

`languages/sentences/CODE.json` maps each English sentence, with {0}, {1}, … for its values ({0_} for one that is a
single word), to its translation. What no entry fits stays English: better the station's own words than none.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

_FOLDER = Path(__file__).parent / "languages" / "sentences"
_PLACEHOLDER = re.compile(r"\{(\d_?)\}")
#: Taking apart costs the square of the length, so a longer one is only split; how deep one may stand in another.
_LONGEST, _DEEPEST = 600, 4


@dataclass(frozen=True, slots=True)
class CatalogueEntry:
    """One sentence: its longest words, without which nothing need be tried; how it is recognised (values as short, and
    as long as they can be); the numbers of its values in their order; and how it is said."""

    words: str
    patterns: tuple[re.Pattern[str], re.Pattern[str]]
    placeholders: tuple[str, ...]
    said: str


@dataclass(frozen=True, slots=True)
class Translation:
    """A sentence said again, and how many characters of it stayed as they were."""

    text: str
    left: int


@lru_cache(maxsize=8)
def catalogue(code: str) -> Mapping[str, str]:
    """English sentence → how the language says it; nothing for English itself."""
    path = _FOLDER / f"{code}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


@lru_cache(maxsize=4096)
def translate(sentence: str, code: str) -> str:
    """The sentence in that language, its values kept; the English one where nothing fits."""
    if not catalogue(code):
        return sentence
    parts = [sentence] if len(sentence) <= _LONGEST else sentence.split("; ")
    return "; ".join(_best_translation(part, code, _DEEPEST).text if len(part) <= _LONGEST else part for part in parts)


@lru_cache(maxsize=8)
def _entries(code: str) -> tuple[CatalogueEntry, ...]:
    return tuple(_entry(english, said) for english, said in catalogue(code).items())


def _entry(english: str, said: str) -> CatalogueEntry:
    parts = _PLACEHOLDER.split(english)
    lazy, greedy = (_pattern(parts, hole) for hole in ("(.+?)", "(.+)"))
    return CatalogueEntry(max(parts[::2], key=len), (lazy, greedy), tuple(hole[0] for hole in parts[1::2]), said)


def _pattern(parts: Sequence[str], value: str) -> re.Pattern[str]:
    """parts: words and holes by turns."""
    taken = (re.escape(p) if i % 2 == 0 else r"(\S+)" if p.endswith("_") else value for i, p in enumerate(parts))
    return re.compile("".join(taken), re.DOTALL)


@lru_cache(maxsize=16384)
def _best_translation(sentence: str, code: str, depth: int) -> Translation:
    """Of all ways to take the sentence apart, the one that leaves the least of it untranslated."""
    ways = [Translation(sentence, len(sentence))]
    if depth:
        ways += _match_whole(sentence, code, depth)
        ways += _split_joined(sentence, code, depth)
    return min(ways, key=lambda way: way.left)


def _match_whole(sentence: str, code: str, depth: int) -> Iterator[Translation]:
    """As one sentence of the catalogue, others perhaps standing in it."""
    for entry in _entries(code):
        for pattern in entry.patterns if entry.words in sentence else ():
            if found := pattern.fullmatch(sentence):
                values = {
                    h: _best_translation(v, code, depth - 1)
                    for h, v in zip(entry.placeholders, found.groups(), strict=True)
                }
                said = _PLACEHOLDER.sub(lambda hole, known=values: known[hole[1]].text, entry.said)  # type: ignore[misc]
                yield Translation(said, sum(v.left for v in values.values()))


def _split_joined(sentence: str, code: str, depth: int) -> Iterator[Translation]:
    """As several sentences one after the other, or as one about somebody: `SN0042: …`."""
    for joint in ("; ", ", ", ": "):
        at = sentence.find(joint)
        while at > 0:
            head, rest = sentence[:at], sentence[at + len(joint) :]
            if joint == ": " or any(e.words in head and e.patterns[0].fullmatch(head) for e in _entries(code)):
                first, after = _best_translation(head, code, depth - 1), _best_translation(rest, code, depth - 1)
                yield Translation(f"{first.text}{joint}{after.text}", first.left + after.left + len(joint))
            at = sentence.find(joint, at + 1)
