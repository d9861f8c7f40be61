"""Tree heads in one append-only file of JSON lines; implements `ports.tree_heads.TreeHeads`."""

import json
import os
from collections.abc import Sequence
from pathlib import Path

from station.domain.records.tree_head import TreeHead
from station.errors import StoreFault
from station.files.json_text import parse_json
from station.files.lock import take
from station.files.system_errors import os_error_reason


class TreeHeadFile:
    """`open` before use, `close` at the end. One process owns the file. A torn last line, of a power cut, was never
    receipted and is cut off. Errors: StoreFault."""

    def __init__(self, path: Path) -> None:
        self.path, self._handle = path, -1
        self._newest: dict[str, dict[str, TreeHead]] = {}

    def open(self) -> None:
        """Reads what is there and takes the file."""
        try:
            self._handle = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            take(self._handle)
            data = self.path.read_bytes()
            whole = data.rfind(b"\n") + 1
            os.ftruncate(self._handle, whole)
            os.lseek(self._handle, 0, os.SEEK_END)
        except OSError as error:
            raise StoreFault("witness-file", path=str(self.path), reason=os_error_reason(error)) from error
        for number, line in enumerate(data[:whole].splitlines(), 1):
            try:
                self._remember(TreeHead.of(parse_json(line)["head"]))
            except (ValueError, KeyError, TypeError) as error:
                raise StoreFault("witness-file-damaged", path=str(self.path), line=number) from error

    def close(self) -> None:
        """Gives the file free; twice is harmless."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1

    def of_station(self, station: str) -> Sequence[TreeHead]:
        """The newest head of each log of a station, in the order in which the logs were first seen."""
        return list(self._newest.get(station, {}).values())

    def append(self, head: TreeHead, at_ns: int, replaces: str) -> None:
        """Keeps a head, and what it replaces; when this returns, it is on the disk."""
        line = json.dumps({"at_ns": at_ns, "replaces": replaces, "head": head.document()}).encode() + b"\n"
        try:
            os.write(self._handle, line)
            os.fsync(self._handle)
        except OSError as error:
            raise StoreFault("witness-file", path=str(self.path), reason=os_error_reason(error)) from error
        self._remember(head)

    def _remember(self, head: TreeHead) -> None:
        logs = self._newest.setdefault(head.station, {})
        logs.pop(head.log_id, None)  # the one that is kept now comes last
        logs[head.log_id] = head
