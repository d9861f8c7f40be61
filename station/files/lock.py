"""Locks on files that die with their process (flock(2)), so that nothing stale ever blocks a start."""

import fcntl
import os
from pathlib import Path


def open_shared(path: Path, mode: int = 0o644) -> int:
    """Opens the file, made if need be, and shares its lock until the handle is closed. Errors: OSError."""
    return _locked(os.open(path, os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC, mode), fcntl.LOCK_SH)


def take(handle: int) -> None:
    """Takes the lock of an open file alone. Errors: BlockingIOError where somebody else has it."""
    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def wait_for(handle: int) -> None:
    """Waits until the lock of an open file is this process's alone; it is let go when the file is closed."""
    fcntl.flock(handle, fcntl.LOCK_EX)


def is_held(path: Path) -> bool:
    """Whether any process holds or shares the lock of a file right now."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        take(handle)
    except BlockingIOError:
        return True
    finally:
        os.close(handle)
    return False


def _locked(handle: int, operation: int) -> int:
    try:
        fcntl.flock(handle, operation)
    except BaseException:
        os.close(handle)
        raise
    return handle
