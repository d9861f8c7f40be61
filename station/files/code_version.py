"""Which code this process runs: what must be the same wherever parts of one computation are done."""

import hashlib
import platform
from functools import cache
from importlib.metadata import version
from pathlib import Path

import station

#: Libraries whose version may change the last bit of a result.
_NUMERIC = ("numpy", "scipy")


@cache
def code_version() -> str:
    """`0.2.0+4f2a…; python 3.11, numpy 2.3.4, scipy 1.16.2`: the digest is of every source file of the package."""
    digest = hashlib.sha256()
    root = Path(station.__file__).parent
    for path in sorted(root.rglob("*.py")):
        digest.update(f"{path.relative_to(root)}\0".encode() + path.read_bytes() + b"\0")
    python = ".".join(platform.python_version_tuple()[:2])
    libraries = ", ".join(f"{name} {version(name)}" for name in _NUMERIC)
    return f"{station.__version__}+{digest.hexdigest()[:16]}; python {python}, {libraries}"
