"""Frames as KCD, PCAN's symbols (SYM) or AUTOSAR (ARXML) describe them: read by cantools, checked as those of a DBC."""

import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from station.errors import ProductError
from station.optional_imports import hide_packages

#: Ending of the file → format, as cantools calls it. Every other ending is a DBC's.
FORMATS: Mapping[str, str] = MappingProxyType({".kcd": "kcd", ".sym": "sym", ".arxml": "arxml"})
#: What begins a message, signal or node.
DEFINITIONS = re.compile(
    r"<(?:Message|Signal|Node|I-SIGNAL|CAN-FRAME|ECU-INSTANCE)\b|^[ \t]*(?:(?:Sig|Var|Mux)[ \t]*=|\[)", re.MULTILINE
)
#: A description of frames declares no document type: an entity could make a small file endless.
_DOCUMENT_TYPE = re.compile(r"<!(?:DOCTYPE|ENTITY)")


def read_messages(path: Path, text: str, used: Mapping[str, Any] | None) -> list[Any]:
    """The messages of cantools that hold signals at an identifier. used: as in `read_layouts`. Errors: ProductError."""
    with hide_packages("asammdf"):  # cantools imports python-can
        from cantools import database  # heavy, and only needed where a product is loaded
        from cantools.database.errors import Error

    kind = FORMATS[path.suffix.lower()]
    if _DOCUMENT_TYPE.search(text):
        raise ProductError("frame-file-document-type", file=str(path))
    try:
        parsed: Any = database.load_string(text, kind, strict=used is None, sort_signals=None)
        messages = [m for m in parsed.messages if m.frame_id is not None and m.signals]
        for message in messages:
            if used is not None and message.name in used:
                message.refresh(strict=True)
    except Error as error:
        why = str(getattr(error, f"e_{kind}", None) or error)
        raise ProductError("frame-file-refused", file=str(path), kind=kind.upper(), why=_plain(why)) from None
    if not messages:
        raise ProductError("frame-file-empty", file=str(path))
    return messages


def _plain(why: str) -> str:
    """The parser's complaint as the middle of a sentence."""
    return "; ".join(line.strip() for line in why.rstrip(".").splitlines() if line.strip()) or "?"
