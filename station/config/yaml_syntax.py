"""What the YAML parser could not read, in sentences of ours: its own are English, and of its inside."""

import re

import yaml

from station.messages import Message

_OPENING = {"sequence": "[", "mapping": "{"}
#: What the parser was about, or stumbled over, and the sentence for it; the first that fits.
_REASONS = (
    (r"quoted scalar found un(expected|known).*(stream|document)", "yaml-quote-open"),
    (r"quoted scalar", "yaml-escape"),
    (r"flow (sequence|mapping) did not find expected ','", "yaml-bracket-open"),
    (r"mapping values are not allowed", "yaml-colon"),
    (r"expected key|'-' indicator|block sequence entries|simple key|expected ':'", "yaml-indent"),
    (r"cannot start any token|expected node content|tab character", "yaml-character"),
    (r"directive|incompatible", "yaml-directive"),
    (r"an (alias|anchor)", "yaml-anchor-name"),
    (r"block scalar", "yaml-block-text"),
    (r"a tag", "yaml-tag"),
    (r"document start", "yaml-second-document"),
)


def syntax_mistake(text: str, exc: yaml.MarkedYAMLError) -> tuple[int, Message]:
    """(line, reason) for what the parser raised over a text."""
    mark = exc.problem_mark or exc.context_mark
    line = mark.line + 1 if mark else 1
    opened = exc.context_mark.line + 1 if exc.context_mark else line
    complaint = f"{exc.context or ''} {exc.problem or ''}"
    id_ = next((id_ for pattern, id_ in _REASONS if re.search(pattern, complaint)), "yaml-unreadable")
    if id_ == "yaml-character":
        return line, _character(text, line, mark.column if mark else 0)
    if id_ == "yaml-bracket-open":
        return line, Message(id_, bracket=next(b for name, b in _OPENING.items() if name in complaint), opened=opened)
    if id_ == "yaml-quote-open":
        return line, Message(id_, opened=opened)
    return line, Message(id_, tag="!") if id_ == "yaml-tag" else Message(id_)


def unusable_character(text: str, exc: yaml.reader.ReaderError) -> tuple[int, Message]:
    """(line, reason) for a character that no YAML may hold."""
    code = exc.character if isinstance(exc.character, int) else ord(exc.character)
    return text[: max(text.find(chr(code)), 0)].count("\n") + 1, Message("line-control-character", code=code)


def _character(text: str, line: int, column: int) -> Message:
    rest = text.splitlines()[line - 1 : line]
    character = rest[0][column : column + 1] if rest else ""
    return Message("yaml-tab") if character == "\t" else Message("yaml-character", character=character)
