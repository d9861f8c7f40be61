"""Recordings that other programs write in forms of their own: recognised by how they begin, to be exported first."""

from pathlib import Path

from station.errors import SamplesError
from station.messages import Message

#: How a file begins, what it is, and what to do.
_BEGINNINGS: tuple[tuple[bytes, str, str], ...] = (
    (b"#ROSBAG", "kind-ros-bag", "remedy-topic-csv"),
    (b"\x89MCAP", "kind-mcap", "remedy-topic-csv-2"),
    (b"SQLite format 3\0", "kind-sqlite", "remedy-database"),
    (b"PK\x03\x04", "kind-spreadsheet", "remedy-save-csv"),
    (b"\xd0\xcf\x11\xe0", "kind-old-spreadsheet", "remedy-save-csv"),
    (b"ULog\x01\x12\x35", "kind-ulog", "remedy-ulog"),
    (b"\xa3\x95\x80", "kind-dataflash", "remedy-dataflash"),
    (b"\x1f\x8b", "kind-compressed", "remedy-unpack"),
    (b"BZh", "kind-compressed", "remedy-unpack"),
    (b"\xfd7zXZ", "kind-compressed", "remedy-unpack"),
    (b"\x28\xb5\x2f\xfd", "kind-compressed", "remedy-unpack"),
    (b"7z\xbc\xaf", "kind-archive", "remedy-unpack"),
    (b"Rar!", "kind-archive", "remedy-unpack"),
    (b"%PDF-", "kind-document", "remedy-export"),
    (b"version https://git-lfs.github.com/", "kind-lfs-pointer", "remedy-lfs-pull"),
)
#: A web page, saved instead of the file that it leads to; letters of any case, blanks ahead.
_PAGE = (b"<!doctype html", b"<html")


def check(path: Path, head: bytes) -> None:
    """head: how the file begins. Errors: SamplesError where that tells a form that is not read."""
    known = [(kind, remedy) for beginning, kind, remedy in _BEGINNINGS if head.startswith(beginning)]
    if head.removeprefix(b"\xef\xbb\xbf").lstrip().lower().startswith(_PAGE):
        known = [("kind-web-page", "remedy-download")]
    if known:
        kind, remedy = known[0]
        raise SamplesError("recording-of-other-program", file=str(path), kind=Message(kind), remedy=Message(remedy))
