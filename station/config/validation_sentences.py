"""Validation errors as sentences a person can act on: line, key, what is wrong, the nearest known key."""

import difflib
from collections.abc import Callable, Mapping, Sequence
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

KeyPath = tuple[str | int, ...]

#: A page of mistakes helps nobody; the rest shows after these are mended.
MOST_MISTAKES = 20


def sentences(exc: ValidationError, model: type[BaseModel], line: Callable[[KeyPath], int]) -> list[str]:
    """One sentence a mistake, in the order of the file: 'line 7, key `dwell.time`: ...'."""
    found = set()
    for error in exc.errors(include_url=False):
        place = tuple(p for p in error["loc"])
        at = line(place)
        key = f", key `{_dotted(place)}`" if place else ""
        found.add((at, f"line {at}{key}: {_mistake(error, model, place)}"))
    ordered = [text for _, text in sorted(found)]
    more = len(ordered) - MOST_MISTAKES
    return ordered if more <= 0 else [*ordered[:MOST_MISTAKES], f"and {more} more"]


def _dotted(place: KeyPath) -> str:
    return ".".join(str(p) for p in place)


def _mistake(error: Any, model: type[BaseModel], place: KeyPath) -> str:
    kind, message = error["type"], str(error["msg"])
    if kind == "extra_forbidden":
        return f"unknown key{_nearest(str(place[-1]), known_keys(model, place[:-1]))}"
    if kind == "missing":
        return "is missing; add it"
    if kind in ("value_error", "assertion_error"):
        return message.removeprefix("Value error, ").removeprefix("Assertion failed, ")
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return f"must be a block of keys, not {_abbreviated(error['input'])}"
    told = message[0].lower() + message[1:]
    told = told.replace("input should be", "must be").replace("input should", "must")
    return f"{told}, not {_abbreviated(error['input'])}"


def _abbreviated(value: Any) -> str:
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _nearest(word: str, known: Sequence[str]) -> str:
    close = difflib.get_close_matches(word[:64], known, n=1, cutoff=0.5)
    if close:
        return f"; did you mean `{close[0]}`?"
    return f"; the known ones are {', '.join(known)}" if known else "; no key may stand here"


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
