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

_END = b"end"
_CREDENTIALS = struct.Struct("3i")
_LONGEST = 4096
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


def ask(path: Path, request: bytes, patience_s: float) -> bytes | None:
    """The answer of who listens there; None where nobody does, or this user may not ask."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as mouth, suppress(OSError):
        mouth.bind("")  # an address of its own, made by the system, for the answer
        mouth.settimeout(patience_s)
        with _short(path) as address:
            mouth.sendto(request, address)
        return mouth.recv(_LONGEST)
    return None


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
        user = _user(ancillary)
        made = None if user is None or flags & socket.MSG_TRUNC else answer(data, user)
        if sender and made is not None:
            with suppress(OSError):  # it no longer waits
                ear.sendto(made, socket.MSG_DONTWAIT, sender)


def _user(ancillary: list[tuple[int, int, bytes]]) -> int | None:
    """The user's id as the kernel vouches for it."""
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, socket.SCM_CREDENTIALS):
            return int(_CREDENTIALS.unpack(data[: _CREDENTIALS.size])[1])
    return None
