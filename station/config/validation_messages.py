"""Validation errors as messages a person can act on: line, key, what is wrong, the nearest known key."""

import difflib
import re
from collections.abc import Callable, Mapping, Sequence
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from station.config.pydantic_errors import TYPES, UNEXPECTED
from station.errors import InvalidValue
from station.messages import Message

KeyPath = tuple[str | int, ...]

#: A pattern that only says which characters there may be.
_OF_CHARACTERS = re.compile(r"\^(\[(?:[^\]\\]|\\.)+\])(?:[*+]|\{[\d,]+\})\$")

#: A page of mistakes helps nobody; the rest shows after these are mended.
MOST_MISTAKES = 20


def _no_line(_place: KeyPath) -> int:
    return 0


def mistakes(exc: ValidationError, model: type[BaseModel], line: Callable[[KeyPath], int] = _no_line) -> list[Message]:
    """One message a mistake, in the order of the file: 'line 7, key `dwell.time`: …'; line 0 is not named."""
    found = [(_place(error), error) for error in exc.errors(include_url=False)]
    found = [(place, error) for place, error in found if not _follows(place, error["type"], [p for p, _ in found])]
    found.sort(key=lambda row: (line(row[0]), _dotted(row[0])))
    rows: dict[Message, None] = {}
    for number, (place, error) in enumerate(found):
        if len(rows) == MOST_MISTAKES:
            return [*rows, Message("more-mistakes", count=len(found) - number)]
        rows[_at(line(place), _dotted(place), _reason(error, model, place))] = None
    return list(rows)


def _place(error: Any) -> KeyPath:
    """The key at fault: a validator of a whole block may name one in it."""
    cause = error.get("ctx", {}).get("error")
    return (*error["loc"], *(cause.below if isinstance(cause, InvalidValue) else ()))


def _follows(place: KeyPath, kind: str, places: Sequence[KeyPath]) -> bool:
    """Whether a list counts as too short only because its own entries are wrong."""
    return kind == "too_short" and any(len(p) > len(place) and p[: len(place)] == place for p in places)


def _at(line: int, key: str, reason: Message) -> Message:
    if not line:
        return Message("mistake-of-key", key=key, reason=reason) if key else reason
    if not key:
        return Message("mistake-at-line", line=line, reason=reason)
    return Message("mistake-at-key", line=line, key=key, reason=reason)


def _dotted(place: KeyPath) -> str:
    return ".".join(str(p) for p in place)


def _reason(error: Any, model: type[BaseModel], place: KeyPath) -> Message:
    kind, context = error["type"], error.get("ctx", {})
    if kind == "extra_forbidden":
        return _unknown_key(str(place[-1]), known_keys(model, place[:-1]))
    if isinstance(cause := context.get("error"), InvalidValue):
        return cause.message
    if kind in ("value_error", "assertion_error"):
        return Message.text(str(context["error"]))
    if kind == "string_pattern_mismatch" and (wrong := _wrong_characters(context["pattern"], error["input"])):
        return Message("value-characters", given=_abbreviated(error["input"]), characters=wrong)
    id_, names = TYPES.get(kind, UNEXPECTED)
    parameters = {name: _plain(context.get(key)) for name, key in names.items()}
    return Message(id_, given=_abbreviated(error["input"]), **parameters)


def _wrong_characters(pattern: str, given: str) -> tuple[str, ...]:
    """What the text holds and the pattern allows nowhere, as Python writes it; nothing where it asks for more."""
    allowed = _OF_CHARACTERS.fullmatch(pattern)
    return tuple(repr(c) for c in dict.fromkeys(given) if not re.match(allowed[1], c))[:8] if allowed else ()


def _plain(value: Any) -> Any:
    """Context of an error as a parameter; pydantic's "'a', 'b' or 'c'" as a list without the English word."""
    if isinstance(value, str):
        return value.replace("' or '", "', '")
    if isinstance(value, float) and value.is_integer():
        return int(value)
    return value if isinstance(value, int | float) else str(value)


def _abbreviated(value: Any) -> str | Message:
    if value is None:
        return Message("value-nothing")
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _unknown_key(word: str, keys: Sequence[str]) -> Message:
    if close := difflib.get_close_matches(word[:64], keys, n=1, cutoff=0.5):
        return Message("unknown-key-near", nearest=close[0])
    return Message("unknown-key-among", keys=tuple(keys)) if keys else Message("unknown-key-no-keys")


def known_keys(model: Any, place: KeyPath) -> tuple[str, ...]:
    """Names of the keys that may stand in the block at `place` of a document of this model."""
    for step in place:
        model = _step(model, step)
    return tuple(field.alias or name for name, field in _fields(model).items())


def _fields(kind: Any) -> Mapping[str, Any]:
    models = [k for k in _choices(kind) if isinstance(k, type) and issubclass(k, BaseModel)]
    return {name: field for m in models for name, field in m.model_fields.items()}


def _step(kind: Any, step: str | int) -> Any:
    for choice in _choices(kind):
        args = [a for a in get_args(choice) if a is not Ellipsis]
        if isinstance(step, int) and args:
            return args[min(step, len(args) - 1)]
        if isinstance(step, str) and get_origin(choice) in (dict, Mapping):
            return args[1]
    for name, field in _fields(kind).items():
        if step in (name, field.alias):
            return field.annotation
    return kind  # the step names a branch of a union, not a key


def _choices(kind: Any) -> tuple[Any, ...]:
    if get_origin(kind) is Annotated:
        return _choices(get_args(kind)[0])
    if get_origin(kind) in (Union, UnionType):
        return tuple(c for arg in get_args(kind) if arg is not NoneType for c in _choices(arg))
    return (kind,)
