"""The work of `station schema`."""

import json
from collections.abc import Mapping
from pathlib import Path

from pydantic import BaseModel

from station.cli import _output
from station.config.settings import Settings
from station.domain.product.product import Product
from station.domain.recipe.recipe import Recipe
from station.errors import UsageError
from station.files.replace import replace_text
from station.messages import Message, system_reason

KINDS: Mapping[str, type[BaseModel]] = {"recipe": Recipe, "product": Product, "config": Settings}
DRAFT = "https://json-schema.org/draft/2020-12/schema"


def schema_text(kind: str) -> str:
    """The schema of one kind of file, as JSON. Errors: UsageError."""
    if kind not in KINDS:
        raise UsageError("schema-unknown-kind", kind=kind[:40], kinds=tuple(KINDS))
    schema = KINDS[kind].model_json_schema(by_alias=True)
    return json.dumps({"$schema": DRAFT, **schema}, indent=1, ensure_ascii=False) + "\n"


def print_or_write(kind: str | None, out: Path | None) -> int:
    """Prints one, or writes one or all. Errors: UsageError."""
    kinds = tuple(KINDS) if kind is None else (kind,)
    if out is None:
        if kind is None:
            raise UsageError("schema-without-kind", kinds=tuple(KINDS))
        _output.print_raw(schema_text(kind).rstrip("\n"))
        return 0
    for file, text in ((out / f"{each}.json", schema_text(each)) for each in kinds):
        try:
            out.mkdir(parents=True, exist_ok=True)
            replace_text(file, text)
        except OSError as exc:
            raise UsageError("file-not-written", file=str(exc.filename or file), why=system_reason(exc)) from exc
        _output.print_message(Message("init-wrote", file=str(file)))
    return 0
