"""Catalogues: language code → id → sentence with holes; and the rendering of a message by one of them."""

import re
import string
import tomllib
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib import resources
from typing import Any

from station.messages.message import Message, Value

_PLURAL = re.compile(r"plural\((?P<one>[^|]*)\|(?P<many>[^)]*)\)")
#: A sentence in place of a hole brings its own full stop, or question mark, to one that goes on or ends there.
_BEFORE = r"(?<=[\w)\]'\"`%°])"
_ENDS_TWICE = re.compile(_BEFORE + r"([.?!。？！])[.。](?=\s|$)")
_ENDS_EARLY = re.compile(_BEFORE + r"[.。](?=[;；])")
_BETWEEN = re.compile(r"[^a-z0-9]+")
_JOIN = re.compile(r"join\((?P<between>.*)\)", re.DOTALL)


@lru_cache(maxsize=1)
def languages() -> tuple[str, ...]:
    """Codes of the languages that have a catalogue; English is the one the logs keep."""
    folder = resources.files("station.messages") / "catalogues"
    return tuple(sorted(entry.name for entry in folder.iterdir() if entry.is_dir() and not entry.name.startswith("_")))


@lru_cache(maxsize=8)
def templates(language: str) -> Mapping[str, str]:
    """Every sentence of a language by its id. Errors: ValueError where two files give one id."""
    found: dict[str, str] = {}
    folder = resources.files("station.messages") / "catalogues" / language
    for file in sorted((f for f in folder.iterdir() if f.name.endswith(".toml")), key=lambda f: f.name):
        part = tomllib.loads(file.read_text(encoding="utf-8"))
        if twice := found.keys() & part.keys():
            raise ValueError(f"{language}/{file.name}: {sorted(twice)} stand in two files")
        found |= part
    return found


def render(message: Message, language: str = "en") -> str:
    """The sentence in that language; in English where the language has none; the id and parameters where none has."""
    template = templates(language).get(message.id) or templates("en").get(message.id)
    if template is None:  # written by a later version
        return " ".join([message.id, *(f"{k}={_text(v, language)}" for k, v in message.parameters.items())])
    text = _Formatter(language).vformat(template, (), message.parameters)
    if any(isinstance(value, Message | list | tuple) for value in message.parameters.values()):
        text = _ENDS_EARLY.sub("", _ENDS_TWICE.sub(r"\1", text))
    return text


def term(name: str, language: str) -> str:
    """The name of a quantity, chart or column in that language; a name without an entry `term-…` as it is."""
    return templates(language).get(term_id(name), name)


def term_id(name: str) -> str:
    """Under which id the catalogues have a name: `cross-axis x from y` as `term-cross-axis-x-from-y`."""
    plain = name.lower().replace("σ", "sigma").replace("−", "minus")
    return f"term-{_BETWEEN.sub('-', plain).strip('-')}"


class _Formatter(string.Formatter):
    """str.format with plurals, sequences and names of quantities; no attributes and no indices: data stay data."""

    def __init__(self, language: str) -> None:
        self._language = language

    def get_field(self, field_name: str, args: Sequence[Any], kwargs: Mapping[str, Any]) -> Any:  # noqa: ARG002
        return kwargs[field_name], field_name

    def format_field(self, value: Any, format_spec: str) -> str:
        if plural := _PLURAL.fullmatch(format_spec):
            return plural["one"] if value == 1 else plural["many"]
        if join := _JOIN.fullmatch(format_spec):
            return join["between"].join(_text(part, self._language) for part in value) or "–"
        if format_spec == "term":
            return term(str(value), self._language)
        if value is None or isinstance(value, Message) or (isinstance(value, Sequence) and not isinstance(value, str)):
            return _text(value, self._language)
        try:
            return format(value, format_spec)
        except ValueError:  # a later version's parameter may be of another kind
            return str(value)


def _text(value: Value, language: str) -> str:
    if isinstance(value, Message):
        return render(value, language)
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(_text(part, language) for part in value) or "–"
    return "–" if value is None else str(value)
