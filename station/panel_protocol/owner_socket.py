"""A process' ear beside its log: a datagram socket, whose requests are answered one after the other.

It needs no page and no network. There are no connections that somebody could use up by holding them open. Who may write
to it the operating system decides by the socket's mode, and it names who wrote.
"""

import os
import select
import socket
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Thread

from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.owner import named_pid

_END = b"end"
_CREDENTIALS = struct.Struct("3i")
_LONGEST, _NOBODY = 4096, -1
#: What a request brings: its bytes and the user id of who wrote; and what it is answered, or None.
Answer = Callable[[bytes, int], bytes | None]


@contextmanager
def answering_requests(path: Path, mode: int, answer: Answer, name: str) -> Iterator[None]:
    """Inside, `answer` is called in a thread of its own, called `name`, for each request.

    Where the file system has no sockets, nobody listens.
    """
    try:
        path.unlink(missing_ok=True)  # of a process that was killed
        ear = _bound(path, mode)
    except OSError:
        yield
        return
    end, wake = socket.socketpair()
    thread = Thread(target=_listen, args=(ear, end, answer), name=name, daemon=True)
    thread.start()
    try:
        yield
    finally:
        wake.send(_END)
        thread.join()
        for one in (ear, end, wake):
            one.close()
        path.unlink(missing_ok=True)


def ask(database: Path, companion: Companion, request: bytes, patience_s: float) -> bytes | None:
    """The answer of the log's owner at that socket; None where nobody listens, this user may not ask, or somebody else
    answers who has put a socket of their own there."""
    path = companion_file(database, companion)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as mouth, suppress(OSError):
        mouth.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        mouth.bind("")  # an address of its own, made by the system, for the answer
        mouth.settimeout(patience_s)
        with _short(path) as address:
            mouth.sendto(request, address)
        answer, ancillary, _, _ = mouth.recvmsg(_LONGEST, socket.CMSG_SPACE(_CREDENTIALS.size))
        pid, user = _sender(ancillary)
        return answer if _speaks_for(database, pid, user) else None
    return None


def _speaks_for(database: Path, pid: int, user: int) -> bool:
    """Whether the log is that user's or that process', or the user is who asks."""
    if user in (0, os.geteuid()) or pid == named_pid(database):
        return True
    with suppress(OSError):
        return user == database.stat().st_uid
    return False


def _bound(path: Path, mode: int) -> socket.socket:
    ear = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        ear.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        os.fchmod(ear.fileno(), mode)  # before the name exists, so that nobody comes in between
        with _short(path) as address:
            ear.bind(address)
        path.chmod(mode)  # what the umask took off
    except OSError:
        ear.close()
        raise
    return ear


@contextmanager
def _short(path: Path) -> Iterator[str]:
    """The address of a socket by its folder's handle: sockaddr_un holds 108 bytes, and folders may be deep."""
    folder = os.open(path.parent, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        yield f"/proc/self/fd/{folder}/{path.name}"
    finally:
        os.close(folder)


def _listen(ear: socket.socket, end: socket.socket, answer: Answer) -> None:
    while True:
        ready, _, _ = select.select([ear, end], [], [])
        if end in ready:
            return
        data, ancillary, flags, sender = ear.recvmsg(_LONGEST, socket.CMSG_SPACE(_CREDENTIALS.size))
        _, user = _sender(ancillary)
        made = None if user == _NOBODY or flags & socket.MSG_TRUNC else answer(data, user)
        if sender and made is not None:
            with suppress(OSError):  # it no longer waits
                ear.sendto(made, socket.MSG_DONTWAIT, sender)


def _sender(ancillary: list[tuple[int, int, bytes]]) -> tuple[int, int]:
    """Process and user as the kernel vouches for them."""
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, socket.SCM_CREDENTIALS):
            pid, user, _ = _CREDENTIALS.unpack(data[: _CREDENTIALS.size])
            return pid, user
    return _NOBODY, _NOBODY
