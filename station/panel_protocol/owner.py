"""Which process writes a log right now, whoever started it."""

from pathlib import Path

from station.files.json_text import read_json
from station.panel_protocol.companion import Companion, companion_file


def owner_pid(database: Path) -> int | None:
    """The pid that holds the log right now; None when nobody does.

    A pid in the lock file counts only while that process has the file open: pids are used again, locks are not
    taken here, because even a short one would turn a starting run away.
    """
    lock, pid = companion_file(database, Companion.OWNER), named_pid(database)
    try:
        handles = list(Path(f"/proc/{pid}/fd").iterdir())
    except OSError:
        return None
    return pid if any(_same_file(handle, lock) for handle in handles) else None


def named_pid(database: Path) -> int | None:
    """The pid that stands in the lock file, of an owner of now or of before; None where there is none."""
    try:
        return int(read_json(companion_file(database, Companion.OWNER))["pid"])
    except (OSError, ValueError, KeyError, TypeError, OverflowError):
        return None


def _same_file(handle: Path, lock: Path) -> bool:
    try:
        return handle.samefile(lock)
    except OSError:
        return False
