"""candump logs (`candump -L`), read and written by hand.

python-can's reader takes error frames for data frames and its writer forgets what they and remote frames hold;
as text the format is one line a frame, so both ways are short and lose nothing but times below 1 µs.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from station.domain.core.types import ERROR, EXTENDED, REMOTE, Frames
from station.errors import LogError

_LINE = re.compile(
    r"\((?P<s>\d{1,11})\.(?P<fraction>\d{1,9})\)\s+(?P<channel>\S+)\s+(?P<id>[0-9A-Fa-f]{1,8})"
    r"#(?:(?P<remote>[Rr])(?P<dlc>[0-8]?)|(?P<flags>#[0-9A-Fa-f])?(?P<data>(?:[0-9A-Fa-f]{2}){0,64}))(?:\s+[RTrt])?"
)
#: A frame as candump prints it in any of its forms, with its stamp and channel or without.
_ANY_FORM = re.compile(
    r"(?:\([\d.: -]+\)\s+)?(?:\w+\s+)?[0-9A-Fa-f]{3,8}(?:##?[0-9A-Fa-fRr.]*|\s+\[\d+\](?:\s+[0-9A-Fa-f]{2})*)(?:\s.*)?"
)
#: Lines that show it, and which share of them.
_HEAD, _MOSTLY = 60, 0.8
#: A frame as read: time, identifier with flags, length, payload in hex.
_Row = tuple[int, int, int, str]


def are_frames(path: Path) -> bool:
    """Whether the lines of a text are frames as candump prints them."""
    try:
        with path.open("rb") as file:
            lines = [line.strip() for line in file.read(1 << 16).decode("ascii", "replace").splitlines()[:_HEAD]]
    except OSError:
        return False  # The reader says why.
    told = [line for line in lines if line and not line.startswith(("#", "//"))]
    return len(told) > 1 and sum(_ANY_FORM.fullmatch(line) is not None for line in told) >= _MOSTLY * len(told)


def read(path: Path, channel: str | None, block: int) -> Iterator[Frames]:
    """Frames of a candump log (of one channel, or all) in blocks. LogError names the line that is none."""
    rows: list[_Row] = []
    with path.open(encoding="ascii", errors="replace") as file:
        for number, line in enumerate(file, 1):
            match = _LINE.fullmatch(line.strip())
            if match is None:
                if not line.strip() or not line.endswith("\n"):
                    continue  # candump was killed in the middle of its last line
                raise LogError("candump-line", file=str(path), line=number, text=line.strip()[:60])
            if channel in (None, match["channel"]):
                rows.append(_row(match))
            if len(rows) == block:
                yield _frames(rows)
                rows = []
    if rows:
        yield _frames(rows)


def write(path: Path, frames: Frames, channel: str) -> None:
    """Frames as `candump -L` writes them; times are cut to whole microseconds, as candump does."""
    with path.open("w", encoding="ascii") as file:
        columns = frames.time_ns.tolist(), frames.can_id.tolist(), frames.length.tolist(), frames.data
        for time_ns, can_id, length, data in zip(*columns, strict=True):
            s, us = divmod(time_ns // 1000, 1_000_000)
            file.write(f"({s:010d}.{us:06d}) {channel} {_address(can_id)}#{_payload(can_id, length, data)}\n")


def _row(match: re.Match[str]) -> _Row:
    can_id = int(match["id"], 16)
    if len(match["id"]) > 3 and not can_id & ERROR:
        can_id |= EXTENDED
    time_ns = int(match["s"]) * 1_000_000_000 + int(match["fraction"].ljust(9, "0"))
    if match["remote"]:
        return time_ns, can_id | REMOTE, int(match["dlc"] or 0), ""
    return time_ns, can_id, len(match["data"]) // 2, match["data"]


def _frames(rows: list[_Row]) -> Frames:
    time_ns, can_id, length, data = zip(*rows, strict=True)
    width = 8 if max(length) <= 8 else 64
    payload = bytes.fromhex("".join(d.ljust(2 * width, "0") for d in data))
    return Frames(
        np.array(time_ns, np.int64),
        np.array(can_id, np.uint32),
        np.array(length, np.uint8),
        np.frombuffer(payload, np.uint8).reshape(len(rows), width),
    )


def _address(can_id: int) -> str:
    if can_id & ERROR:
        return f"{can_id & (ERROR | 0x1FFF_FFFF):08X}"
    return f"{can_id & 0x1FFF_FFFF:08X}" if can_id & EXTENDED else f"{can_id & 0x7FF:03X}"


def _payload(can_id: int, length: int, data: "np.ndarray[tuple[int], np.dtype[np.uint8]]") -> str:
    if can_id & REMOTE and not can_id & ERROR:
        return f"R{length}" if length else "R"
    hexed = data[:length].tobytes().hex().upper()
    return hexed if length <= 8 else f"#0{hexed}"
