"""Labels of pages, certificates and charts: one JSON file a language, every one with the same keys."""

import json
from collections.abc import Mapping
from functools import lru_cache
from importlib import resources


@lru_cache(maxsize=1)
def all_texts() -> Mapping[str, Mapping[str, str]]:
    """Language code → key → text."""
    found = sorted(f.name for f in resources.files(__name__).iterdir() if f.name.endswith(".json"))
    folder = resources.files(__name__)
    return {name[:-5]: json.loads((folder / name).read_text(encoding="utf-8")) for name in found}


def check_names() -> tuple[str, ...]:
    """Everything that a unit may have failed, as the log names it."""
    return tuple(sorted(k.removeprefix("check_") for k in all_texts()["en"] if k.startswith("check_")))
