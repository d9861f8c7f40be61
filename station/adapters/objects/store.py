"""Objects in a folder, each durable when it has its name, or at an fsspec address (`ports.objects.ObjectStore`)."""

import hashlib
import os
import stat
from pathlib import Path
from typing import Any

from station.errors import ConfigError, LogError, StoreFault
from station.files.replace import replacing
from station.files.system_errors import os_error_reason
from station.messages import Message
from station.ports.objects import ObjectStore


def open_objects(address: str) -> ObjectStore:
    """The store at a path or at an address such as `s3://bucket/frames`. Errors: ConfigError."""
    if "://" not in address:
        return FolderObjects(Path(address))
    try:
        from fsspec.core import url_to_fs

        system, root = url_to_fs(address)
    except (ImportError, ValueError, OSError) as error:
        raise ConfigError("objects-address", address=address, why=" ".join(str(error).split())) from error
    return RemoteObjects(system, root, address)


def _name(sha256: bytes) -> str:
    text = sha256.hex()
    return f"{text[:2]}/{text}"


def _checked(sha256: bytes, data: bytes, where: str) -> bytes:
    if hashlib.sha256(data).digest() != sha256:
        raise LogError("object-damaged", sha256=sha256.hex(), where=where)
    return data


class FolderObjects:
    """One file an object, in 256 folders."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def put(self, data: bytes) -> bytes:
        """Keeps the bytes; content and name are on the disk when this returns.

        What bears the name and is something else (damaged, put there by somebody, a link) is replaced.
        """
        sha256 = hashlib.sha256(data).digest()
        path = self._root / _name(sha256)
        try:
            if not _holds(path, data):
                path.parent.mkdir(parents=True, exist_ok=True)
                path.unlink(missing_ok=True)  # a device, a pipe or a database, too, which no report may replace
                with replacing(path, durable=True) as part:
                    part.write_bytes(data)
        except OSError as error:
            raise _unwritten(str(self._root), os_error_reason(error)) from error
        return sha256

    def get(self, sha256: bytes) -> bytes:
        """The bytes, checked against their name."""
        try:
            return _checked(sha256, _ordinary(self._root / _name(sha256)), str(self._root))
        except OSError as error:
            raise LogError("object-missing", sha256=sha256.hex(), where=str(self._root)) from error

    def remove(self, sha256: bytes) -> None:
        """Forgets the bytes."""
        try:
            (self._root / _name(sha256)).unlink(missing_ok=True)
        except OSError as error:
            raise _unwritten(str(self._root), os_error_reason(error)) from error


class RemoteObjects:
    """ObjectStore behind an fsspec file system, whose single writes are whole or not at all."""

    def __init__(self, system: Any, root: str, address: str) -> None:
        self._system, self._root, self._address = system, root.rstrip("/"), address

    def put(self, data: bytes) -> bytes:
        """Keeps the bytes; what bears the name and is something else is replaced."""
        sha256 = hashlib.sha256(data).digest()
        path = f"{self._root}/{_name(sha256)}"
        try:
            if not self._system.exists(path) or self._system.cat_file(path) != data:
                self._system.makedirs(path.rpartition("/")[0], exist_ok=True)
                self._system.pipe_file(path, data)
        except OSError as error:
            raise _unwritten(self._address, Message.text(" ".join(str(error).split()))) from error
        return sha256

    def get(self, sha256: bytes) -> bytes:
        """The bytes, checked against their name."""
        try:
            return _checked(sha256, self._system.cat_file(f"{self._root}/{_name(sha256)}"), self._address)
        except OSError as error:
            raise LogError("object-missing", sha256=sha256.hex(), where=self._address) from error

    def remove(self, sha256: bytes) -> None:
        """Forgets the bytes."""
        path = f"{self._root}/{_name(sha256)}"
        try:
            if self._system.exists(path):
                self._system.rm_file(path)
        except OSError as error:
            raise _unwritten(self._address, Message.text(" ".join(str(error).split()))) from error


def _ordinary(path: Path) -> bytes:
    """A file's content; a pipe in its place is not waited for. Errors: OSError."""
    if not stat.S_ISREG(path.stat().st_mode):
        raise FileNotFoundError(path)
    return path.read_bytes()


def _holds(path: Path, data: bytes) -> bool:
    """Whether the file has this content, and no link leads to it: elsewhere it may be altered under another name."""
    status = path.lstat() if os.path.lexists(path) else None
    if status is None or not stat.S_ISREG(status.st_mode) or status.st_size != len(data):
        return False
    return path.read_bytes() == data


def _unwritten(where: str, reason: Message) -> StoreFault:
    return StoreFault("object-not-written", where=where, reason=reason)
