"""The head file `<log>.head`: the newest seal, kept outside the log, so that a cut-off tail shows.

One line of fixed length, written over after each commit and never before it, so that after a power cut it may
lag behind the log but never run ahead of it.
"""

import json
import os
from pathlib import Path

from station.domain.records.chain import SCHEMA
from station.messages import Message
from station.ports.store import LogHead

_LENGTH = 256


def head_file_path(log: Path) -> Path:
    """Where the head file of a log lies."""
    return log.with_name(log.name + ".head")


class Anchor:
    """Writes the head file. Errors: OSError as the system raises it."""

    def __init__(self, log: Path, log_id: str) -> None:
        self._fields = json.dumps({"schema": SCHEMA, "log_id": log_id}).removesuffix("}")
        self._handle = os.open(head_file_path(log), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)

    def write(self, head: LogHead, durable: bool) -> None:
        """Writes this head; `durable` waits for the disk."""
        line = f'{self._fields}, "number": {head.number}, "hash": "{head.hash}"}}'
        os.pwrite(self._handle, line.encode().ljust(_LENGTH - 1) + b"\n", 0)
        if durable:
            os.fdatasync(self._handle)

    def close(self) -> None:
        """Closes the file; twice is harmless."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1


def read(log: Path, log_id: str) -> LogHead | Message:
    """The head as written, or why there is none for this log."""
    path = head_file_path(log)
    try:
        line = json.loads(path.read_bytes()[:_LENGTH] or b"null")
        head = LogHead(int(line["number"]), bytes.fromhex(line["hash"]).hex())
    except FileNotFoundError:
        return Message("head-file-missing", path=str(path))
    except (OSError, ValueError, KeyError, TypeError):
        return Message("head-file-unreadable", path=str(path))
    if line.get("log_id") != log_id:
        return Message("head-file-of-another-log", path=str(path))
    return head
