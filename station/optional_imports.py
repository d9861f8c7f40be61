"""Imports libraries without the heavy ones that they could use if they were there (docs/decisions/0023-start-up.md)."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.abc import MetaPathFinder


class _NotInstalled(MetaPathFinder):
    """Finds that some packages are not installed, before any other finder is asked."""

    def __init__(self, packages: tuple[str, ...]) -> None:
        self._packages = packages

    def find_spec(self, fullname: str, _path: object, _target: object = None) -> None:
        """Errors: ModuleNotFoundError of such a package."""
        if fullname in self._packages:
            raise ModuleNotFoundError(f"No module named {fullname!r}", name=fullname)


@contextmanager
def hide_packages(*packages: str) -> Iterator[None]:
    """What is imported inside finds these packages not installed, unless they are loaded already. Outside they import
    as ever."""
    finder = _NotInstalled(packages)
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)


def load_arrow() -> None:
    """Loads pyarrow so that it does not load pandas: it asks once whether an array is one of pandas, and remembers that
    there is none. What needs pandas itself asks again, and finds it."""
    import pyarrow as pa

    with hide_packages("pandas"):
        pa.array([])
