"""The value that events, reasons, refusals and errors carry instead of a rendered sentence."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

#: What a parameter may be. A nested message is rendered with the one that holds it.
Scalar: TypeAlias = str | int | float | bool | None
Value: TypeAlias = "Scalar | Message | Sequence[Scalar | Message]"

#: A sentence kept by an older log or written by somebody else: shown as it stands, in every language.
TEXT = "text"


@dataclass(frozen=True, slots=True, init=False)
class Message:
    """`Message("gain-limit", axis="y", value=0.9476)`: an id of the catalogues and the parameters of its sentence."""

    id: str
    parameters: Mapping[str, Value] = field(default_factory=dict)

    def __init__(self, id: str, /, **parameters: Value) -> None:  # noqa: A002 - the word of the format
        object.__setattr__(self, "id", id)
        object.__setattr__(self, "parameters", parameters)

    def __hash__(self) -> int:
        return hash((self.id, repr(sorted(self.parameters.items(), key=lambda item: item[0]))))

    @staticmethod
    def text(sentence: str) -> "Message":
        """A sentence that has no id."""
        return Message(TEXT, text=sentence)

    def document(self) -> dict[str, Any]:
        """As JSON keeps it: {"id": …, parameter: value, …}; nested messages as documents of their own."""
        return {"id": self.id} | {name: _plain(value) for name, value in self.parameters.items()}

    @staticmethod
    def recorded(document: Mapping[str, Any]) -> "Message":
        """The message of a log's entry; its sentence as it stands where an older version kept nothing else."""
        stored = document.get("message")
        return Message.of(stored) if stored else Message.text(str(document["sentence"]))

    @staticmethod
    def of(document: Mapping[str, Any]) -> "Message":
        """The message that `document()` described."""
        parameters = {name: _value(value) for name, value in document.items() if name != "id"}
        return Message(str(document["id"]), **parameters)


def _plain(value: Value) -> Any:
    if isinstance(value, Message):
        return value.document()
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None  # JSON knows no other
    return value


def _value(plain: Any) -> Value:
    if isinstance(plain, Mapping):
        return Message.of(plain)
    if isinstance(plain, list):
        return tuple(_value(part) for part in plain)  # type: ignore[misc]
    return plain  # type: ignore[no-any-return]
