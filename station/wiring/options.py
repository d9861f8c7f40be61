"""The options of an adapter: the keys that config.yaml gives it in its block, checked by the adapter's own model."""

from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel

from station.config.documents import Document, validate
from station.errors import ConfigError

Options = TypeVar("Options", bound=BaseModel)


def options_of(
    block: str | tuple[str, ...], given: Mapping[str, Any], document: Document, model: type[Options]
) -> Options:
    """The options that `block` gives its adapter. Errors: ConfigError with line and key."""
    if not given:
        return model()
    part = document.part(*((block,) if isinstance(block, str) else block))
    return validate(Document(part.path, dict(given), part.lines), model, ConfigError)
