"""The head file `<log>.head`: the newest seal, kept outside the log, so that a cut-off tail shows.

One line of fixed length, written over after each commit and never before it, so that after a power cut it may
lag behind the log but never run ahead of it.
"""

import json
import os
from pathlib import Path

from station.domain.records.chain import SCHEMA
from station.ports.store import LogHead

_LENGTH = 256


def head_file_path(log: Path) -> Path:
    """Where the head file of a log lies."""
    return log.with_name(log.name + ".head")


class Anchor:
    """Writes the head file. Errors: OSError as the system raises it."""

    def __init__(self, log: Path, log_id: str) -> None:
        self._told = json.dumps({"schema": SCHEMA, "log_id": log_id}).removesuffix("}")
        self._handle = os.open(head_file_path(log), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)

    def write(self, head: LogHead, durable: bool) -> None:
        """Keeps this head; `durable` waits for the disk."""
        line = f'{self._told}, "number": {head.number}, "hash": "{head.hash}"}}'
        os.pwrite(self._handle, line.encode().ljust(_LENGTH - 1) + b"\n", 0)
        if durable:
            os.fdatasync(self._handle)

    def close(self) -> None:
        """Closes the file; twice is harmless."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1


def read(log: Path, log_id: str) -> LogHead | str:
    """The head as kept, or a sentence that says why there is none for this log."""
    path = head_file_path(log)
    try:
        said = json.loads(path.read_bytes()[:_LENGTH] or b"null")
        head = LogHead(int(said["number"]), bytes.fromhex(said["hash"]).hex())
    except FileNotFoundError:
        return f"the head file {path} is missing, so a cut-off end of the log could not be seen"
    except (OSError, ValueError, KeyError, TypeError):
        return f"the head file {path} cannot be read, so a cut-off end of the log could not be seen"
    if said.get("log_id") != log_id:
        return f"the head file {path} belongs to another log"
    return head
