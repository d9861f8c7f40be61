"""The place that a path leads to, by whatever links."""

import os
from pathlib import Path

from station.errors import UsageError
from station.messages import Message


def real_path(path: Path) -> Path:
    """As `Path.resolve`. Errors: UsageError where links form a loop, so that there is no such place."""
    real = Path(os.path.realpath(path))
    if os.path.islink(real):  # noqa: PTH114 - False, and no error, where one may not look
        raise UsageError("file-unreadable", file=str(path), why=Message("system-link-loop"))
    return real
