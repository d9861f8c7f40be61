"""YAML text → checked, frozen models; every mistake at once, with file, line, key and remedy."""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from station.config.validation_messages import mistakes
from station.config.yaml_syntax import syntax_mistake, unusable_character
from station.errors import InputError
from station.messages import Message, system_reason

Model = TypeVar("Model", bound=BaseModel)
KeyPath = tuple[str | int, ...]

#: Beyond these a file is not a recipe but an accident or an attack.
MOST_BYTES, BYTES_A_NODE, MOST_DEPTH = 1_000_000, 50, 32

#: C0 and C1 controls but tab and line ends, and the marks that reorder text on a screen.
CONTROL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")

# Plain scalars as in the core schema of YAML 1.2: `off`, `NO` and `2027-03-01` stay text.
_INT = re.compile(r"[-+]?[0-9]{1,40}|0x[0-9a-fA-F]{1,32}|0o[0-7]{1,40}")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]{1,4})?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
#: Of a file with another ending that is no YAML, the ending is what is wrong.
_ENDINGS = ("", ".yaml", ".yml", ".json")
_WORDS = {"true": True, "false": False, "null": None, "~": None, "": None}


@dataclass(frozen=True, slots=True)
class Document:
    """The data of a file, and the line of each part of them. path: as a person would name the file."""

    path: Path
    data: Any
    lines: Mapping[KeyPath, int]

    def line(self, place: KeyPath) -> int:
        """Line of a part, or of the nearest part around it."""
        while place and place not in self.lines:
            place = place[:-1]
        return self.lines.get(place, 1)

    def part(self, *place: str | int) -> "Document":
        """One block of the document as a document of its own; lines stay those of the file."""
        data = self.data
        for key in place:
            data = data[key]
        size = len(place)
        lines = {at[size:]: line for at, line in self.lines.items() if at[:size] == place}
        return Document(self.path, data, lines)


def load_document(path: Path, error: type[InputError] = InputError, most_bytes: int = MOST_BYTES) -> Document:
    """Reads a YAML file without tags, repeated keys or control characters, in bounded time; aliases are counted out.

    most_bytes: what is longer, or holds more than one node in 50 bytes of that, is refused. Errors: `error`, naming
    file, line and remedy.
    """
    builder = _Builder(path, error, most_bytes // BYTES_A_NODE)
    text = _text(path, error, most_bytes)
    try:
        data = builder.build(yaml.parse(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)))
    except yaml.MarkedYAMLError as exc:
        line, why = syntax_mistake(text, exc)
        if path.suffix.lower() not in _ENDINGS:
            raise error("file-no-yaml", file=str(path), ending=path.suffix) from exc
        raise error("line-of-file", file=str(path), line=line, reason=why) from exc
    except yaml.reader.ReaderError as exc:
        line, why = unusable_character(text, exc)
        raise error("line-of-file", file=str(path), line=line, reason=why) from exc
    except RecursionError as exc:
        raise error("file-nested-too-deep", file=str(path)) from exc
    if not isinstance(data, dict) and path.suffix.lower() not in _ENDINGS:
        raise error("file-no-yaml", file=str(path), ending=path.suffix)
    return Document(path, data, builder.lines)


def validate(document: Document, model: type[Model], error: type[InputError]) -> Model:
    """The document as a `model`; `error` carries every mistake in it, each with line, key and remedy."""
    try:
        return model.model_validate(document.data)
    except ValidationError as exc:
        reasons = mistakes(exc, model, document.line)
        raise error("document-mistakes", file=str(document.path), mistakes=reasons) from None


def at_key(document: Document, place: KeyPath, reason: Message) -> Message:
    """A mistake with the line and the key where it is."""
    return Message("mistake-at-key", line=document.line(place), key=".".join(map(str, place)), reason=reason)


def canonical(model: BaseModel) -> str:
    """The model as JSON that is the same for the same content: defaults written out, keys sorted, no comments."""
    data = model.model_dump(mode="json", by_alias=True)
    return json.dumps(data, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def content_hash(model: BaseModel) -> str:
    """SHA-256 of `canonical`, in hexadecimal."""
    return hashlib.sha256(canonical(model).encode()).hexdigest()


def _text(path: Path, error: type[InputError], most_bytes: int) -> str:
    try:
        with path.open("rb") as file:
            raw = file.read(most_bytes + 1)
    except OSError as exc:
        raise error("file-unreadable", file=str(path), why=system_reason(exc)) from exc
    if len(raw) > most_bytes:
        raise error("file-too-long", file=str(path), limit=most_bytes)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as exc:
        line = raw[: exc.start].count(b"\n") + 1
        raise error("line-of-file", file=str(path), line=line, reason=Message("line-not-utf8")) from exc
    if bad := CONTROL.search(text):
        line = text[: bad.start()].count("\n") + 1
        raise error("line-of-file", file=str(path), line=line, reason=_control(bad[0]))
    return text


class _Builder:
    """Builds plain data from parse events, so that nothing is expanded, tagged or constructed on the way."""

    def __init__(self, path: Path, error: type[InputError], most_nodes: int) -> None:
        self.path, self.error, self.most_nodes = path, error, most_nodes
        self.lines: dict[KeyPath, int] = {}
        self.nodes = 0
        self.anchors: dict[str, tuple[Any, int]] = {}

    def build(self, events: Iterator[yaml.Event]) -> Any:
        data: Any = None
        documents = 0
        for event in events:
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    raise self.refusal(event, Message("yaml-second-document"))
                data = self.node(next(events), events, ())
        return data

    def node(self, event: yaml.Event, events: Iterator[yaml.Event], place: KeyPath) -> Any:
        self.check(event, place)
        if isinstance(event, yaml.AliasEvent):
            return self.alias(event)
        before = self.nodes
        data = self.content(event, events, place)
        if isinstance(event, yaml.NodeEvent) and event.anchor is not None:
            self.anchors[event.anchor] = data, self.nodes - before
        return data

    def content(self, event: yaml.Event, events: Iterator[yaml.Event], place: KeyPath) -> Any:
        if isinstance(event, yaml.SequenceStartEvent):
            return self.sequence(events, place)
        if isinstance(event, yaml.MappingStartEvent):
            return self.mapping(events, place)
        return self.scalar(event)

    def alias(self, event: yaml.AliasEvent) -> Any:
        """The value of an anchor. It counts as if it were written out, so aliases of aliases cannot explode."""
        if event.anchor not in self.anchors:
            raise self.refusal(event, Message("yaml-alias-without-anchor", alias=str(event.anchor)))
        data, size = self.anchors[event.anchor]
        self.count(event, size)
        return data

    def check(self, event: yaml.Event, place: KeyPath) -> None:
        self.count(event, 1)
        self.lines.setdefault(place, _line(event))
        if (tag := getattr(event, "tag", None)) is not None:
            raise self.refusal(event, Message("yaml-tag", tag=str(tag)))
        if len(place) > MOST_DEPTH:
            raise self.too_large(event)

    def count(self, event: yaml.Event, nodes: int) -> None:
        self.nodes += nodes
        if self.nodes > self.most_nodes:
            raise self.too_large(event)

    def sequence(self, events: Iterator[yaml.Event], place: KeyPath) -> list[Any]:
        out: list[Any] = []
        while not isinstance(event := next(events), yaml.SequenceEndEvent):
            out.append(self.node(event, events, (*place, len(out))))
        return out

    def mapping(self, events: Iterator[yaml.Event], place: KeyPath) -> dict[str, Any]:
        out: dict[str, Any] = {}
        while not isinstance(event := next(events), yaml.MappingEndEvent):
            if not isinstance(event, yaml.ScalarEvent):
                raise self.refusal(event, Message("yaml-key-not-text"))
            key = str(event.value)
            if key in out:
                raise self.refusal(event, Message("yaml-key-twice", key=key))
            self.lines[(*place, key)] = _line(event)
            self.check(event, (*place, key))
            out[key] = self.node(next(events), events, (*place, key))
        return out

    def scalar(self, event: Any) -> Any:
        text = str(event.value)
        if bad := CONTROL.search(text):
            raise self.refusal(event, _control(bad[0]))
        return text if event.style not in (None, "") else parse_plain_scalar(text)

    def too_large(self, event: yaml.Event) -> InputError:
        return self.refusal(event, Message("yaml-too-large", limit=self.most_nodes, depth=MOST_DEPTH))

    def refusal(self, event: yaml.Event, why: Message) -> InputError:
        return self.error("line-of-file", file=str(self.path), line=_line(event), reason=why)


def _control(character: str) -> Message:
    return Message("line-control-character", code=ord(character))


def parse_plain_scalar(text: str) -> Any:
    """An unquoted scalar as YAML 1.2's core schema reads it."""
    if _INT.fullmatch(text):
        return int(text, 0) if text[:2] in ("0x", "0o") else int(text)
    if _FLOAT.fullmatch(text):
        return float(re.sub(r"\.(?=inf|nan)", "", text.lower()))
    return _WORDS.get(text.lower(), text)


def _line(event: yaml.Event) -> int:
    return event.start_mark.line + 1 if event.start_mark else 1
