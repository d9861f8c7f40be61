"""The package's own source, parsed once for all tests that read it."""

import ast
from functools import cache
from pathlib import Path

import station

PACKAGE = Path(station.__file__).parent


@cache
def trees() -> dict[Path, ast.Module]:
    """The syntax tree of every module of the package, by its path, in the order of their names."""
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(PACKAGE.rglob("*.py"))}


@cache
def calls() -> tuple[tuple[Path, ast.Call], ...]:
    """Every call in the package, with the module in which it stands."""
    return tuple((path, n) for path, tree in trees().items() for n in ast.walk(tree) if isinstance(n, ast.Call))
