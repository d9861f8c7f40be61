"""Imports libraries without the heavy ones that they could use if they were there (docs/decisions/0023-start-up.md)."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def hide_packages(*packages: str) -> Iterator[None]:
    """What is imported inside finds these packages not installed, unless they are loaded already.

    A name that stands in sys.modules as None cannot be imported (The Python Language Reference, 5.3.1). Outside they
    import as ever.
    """
    hidden = [name for name in packages if name not in sys.modules]
    sys.modules.update(dict.fromkeys(hidden))  # type: ignore[arg-type]
    try:
        yield
    finally:
        for name in hidden:
            del sys.modules[name]
