"""Whether anybody serves the operator's page of a log: a shared lock that dies with the page's process."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from station.errors import StationFault
from station.files import lock
from station.messages import system_reason
from station.panel_protocol.companion import Companion, companion_file


@contextmanager
def serving(database: Path) -> Iterator[None]:
    """While it lasts, the page of this log is there; several may be. Errors: StationFault where no file can be made."""
    path = companion_file(database, Companion.PRESENCE)
    try:
        handle = lock.open_shared(path)
    except OSError as exc:
        raise StationFault("presence-not-made", path=str(path), reason=system_reason(exc)) from exc
    try:
        yield
    finally:
        os.close(handle)


def is_served(database: Path) -> bool:
    """Whether a page of this log is there right now."""
    return lock.is_held(companion_file(database, Companion.PRESENCE))
