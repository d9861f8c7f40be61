"""Where a log's newest head is kept outside it, so that a cut-off tail or a restored backup shows.

Beside the log lies `<log>.head`, one line of fixed length, written over after each commit and never before it: after a
power cut it may lag behind the log but never run ahead of it. Folders of `anchors:` in config.yaml get the head with
every finished attempt; a write-once folder gets a new file each time.
"""

import errno
import os
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from station.domain.records import head as heads
from station.domain.records.head import AnchorFinding, LogEnd, SealedHead
from station.domain.records.merkle import Tree
from station.domain.records.tree_head import WitnessReceipt
from station.files.ordinary import open_ordinary, read_ordinary
from station.files.real_path import real_path

#: How the place beside the log is called; every other place may lag by any number of loads.
HEAD_FILE = "head file"
_LENGTH = 512
_NUMBERED = re.compile(r"(\d+)\.head")


class AnchorPlace(Protocol):
    """One place that keeps heads."""

    @property
    def name(self) -> str:
        """How sentences call it."""

    @property
    def lags(self) -> bool:
        """Whether it may be behind by any number of loads."""

    def read(self) -> SealedHead | None:
        """The newest head there; None where there is none. Errors: OSError, ValueError for what is no head."""

    def write(self, head: SealedHead, *, durable: bool) -> None:
        """Keeps a head; `durable` waits for the disk. Errors: OSError."""


class WitnessPlace(AnchorPlace, Protocol):
    """A place that checks for itself that the log it knew is a beginning of the one it is shown."""

    def submit(self, head: SealedHead, tree: Tree, replaces: str = "") -> WitnessReceipt:
        """Shows it the log up to `head`. replaces: end of the log whose place this one takes. Errors: OSError."""


def head_file_path(log: Path) -> Path:
    """Where the head file of a log lies."""
    return log.with_name(log.name + ".head")


class HeadFile:
    """The file beside the log. `open` before the first write, `close` at the end; twice is harmless."""

    lags = False

    def __init__(self, log: Path) -> None:
        self._path, self._handle, self._inode = head_file_path(log), -1, (-1, -1)
        self.name = f"{HEAD_FILE} {self._path}"

    def open(self) -> None:
        """Opens the file to be written, making it where there is none. Errors: OSError, also for a link: what it points
        to would be written over."""
        new = not self._path.exists()
        self._handle = open_ordinary(self._path, os.O_RDWR | os.O_CREAT)
        ours = os.fstat(self._handle)
        self._inode = ours.st_dev, ours.st_ino
        if new:
            sync_folder(self._path)

    def read(self) -> SealedHead | None:
        """The head as kept; None where a start was broken off before it was written, too."""
        data = _read(self._path)
        return SealedHead.parse(data) if data else None

    def write(self, head: SealedHead, *, durable: bool) -> None:
        """Writes the line over, whatever became of the file's name: see `check_in_place`. Errors: OSError."""
        os.pwrite(self._handle, head.line().encode().ljust(_LENGTH - 1) + b"\n", 0)
        if durable:
            os.fdatasync(self._handle)

    def check_in_place(self) -> None:
        """OSError where the file was removed, exchanged or given a second name: nobody finds the head in its place."""
        with suppress(FileNotFoundError):
            there = self._path.lstat()
            if (there.st_dev, there.st_ino) == self._inode and there.st_nlink == 1:
                return
        raise OSError(errno.ESTALE, os.strerror(errno.ESTALE), str(self._path))

    def close(self) -> None:
        """Closes the file."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1


@dataclass(frozen=True, slots=True)
class AnchorFolder:
    """A folder elsewhere. stem: station and log name; write_once: a file a head, none ever written over."""

    folder: Path
    stem: str
    write_once: bool = False

    lags = True

    @property
    def name(self) -> str:
        """Where, for a person."""
        return str(self.folder / (f"{self.stem}.*.head" if self.write_once else f"{self.stem}.head"))

    def read(self) -> SealedHead | None:
        """The head there; of a write-once folder that with the highest number."""
        path = self._newest() if self.write_once else self.folder / f"{self.stem}.head"
        if path is None or not path.exists():
            self.folder.stat()  # a share that is away is no missing head
            return None
        return SealedHead.parse(_read(path) or "")

    def write(self, head: SealedHead, *, durable: bool) -> None:
        """Keeps the head with finished attempts only: a share may be slow."""
        if not durable:
            return
        data = (head.line() + "\n").encode()
        if self.write_once:
            with suppress(FileExistsError):
                _write_synced(self.folder / f"{self.stem}.{head.number}.head", data, os.O_EXCL)
            return
        new = self.folder / f"{self.stem}.head.new"
        _write_synced(new, data, os.O_TRUNC)
        new.replace(self.folder / f"{self.stem}.head")

    def _newest(self) -> Path | None:
        numbered = {
            int(found[1]): entry
            for entry in self.folder.glob(f"{self.stem}.*.head")
            if (found := _NUMBERED.fullmatch(entry.name.removeprefix(f"{self.stem}.")))
        }
        return numbered[max(numbered)] if numbered else None


def _read(path: Path) -> str | None:
    """The line there; None where nothing is. Errors: OSError; ValueError for a link, a folder, a pipe, or what is
    longer than any head: else whoever puts it there would have the place pass for one that is away."""
    try:
        return read_ordinary(path, _LENGTH, follow=False).decode("utf-8", "replace")
    except FileNotFoundError:
        return None
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise ValueError("it is a link") from error
        raise


def sync_folder(path: Path) -> None:
    """The name of a new file is durable only when its folder is."""
    handle = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _write_synced(path: Path, data: bytes, flag: int) -> None:
    handle = open_ordinary(path, os.O_WRONLY | os.O_CREAT | flag)
    try:
        os.write(handle, data)
        os.fsync(handle)
    finally:
        os.close(handle)


def folders_of_one_fate(log: Path, anchors: Sequence[AnchorFolder]) -> tuple[str, str] | None:
    """Two places that are one folder under different names, the log's own among them; None where there are none.

    Whoever restores that folder restores every head in it.
    """
    known = dict[tuple[int, int], str]()
    for folder in (real_path(log).parent, *(anchor.folder for anchor in anchors)):
        try:
            found = folder.stat()
        except OSError:
            continue  # it is away
        if first := known.get((found.st_dev, found.st_ino)):
            return first, str(folder)
        known[found.st_dev, found.st_ino] = str(folder)
    return None


def compare(places: Sequence[AnchorPlace], log: LogEnd, known: frozenset[str]) -> list[AnchorFinding]:
    """What the places that can be reached say against a log. known: names of places that it was kept at."""
    found = list[AnchorFinding]()
    for place in places:
        try:
            head = place.read()
        except OSError:
            continue  # it is away: said when the next head cannot be kept there
        except ValueError:
            found.append(heads.unreadable(place.name))
        else:
            if head is None:
                found += [heads.missing(place.name)] if log.number and (place.name in known or not place.lags) else []
            elif finding := heads.against(place.name, head, log, lags=place.lags):
                found.append(finding)
    return found
