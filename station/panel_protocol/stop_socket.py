"""A run's own ear for a stop: a datagram socket beside the log.

It needs no page, no network and no signal. There are no connections that somebody could use up by holding them open.
Who may write to it (mode 0660: the run's user and group) the operating system decides, and it names who wrote.
"""

import os
import pwd
import select
import socket
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Thread

from station.panel_protocol.companion import Companion, companion_file

_STOP, _STOPPING, _END = b"stop", b"stopping ", b"end"
#: User and group of the run may stop it; anybody on the machine may not.
_MODE = 0o660
_CREDENTIALS = struct.Struct("3i")
#: A run answers at once, whatever else it does.
PATIENCE_S = 1.0


@contextmanager
def listening_for_stop(database: Path, stop: Callable[[str], None]) -> Iterator[None]:
    """Inside, `stop` is called, in a thread of its own, with the name of whoever asks the run on this log to end.

    Only the owner of the log listens. Where the file system has no sockets, nobody does: signals remain.
    """
    path = companion_file(database, Companion.STOP)
    try:
        path.unlink(missing_ok=True)  # of a run that was killed
        ear = _bound(path)
    except OSError:
        yield
        return
    end, wake = socket.socketpair()
    thread = Thread(target=_listen, args=(ear, end, stop), name="stop", daemon=True)
    thread.start()
    try:
        yield
    finally:
        wake.send(_END)
        thread.join()
        for one in (ear, end, wake):
            one.close()
        path.unlink(missing_ok=True)


def stop_by_socket(database: Path, patience_s: float = PATIENCE_S) -> int | None:
    """Asks the run on this log to stop; its pid. None where nobody listens, or this user may not ask."""
    path = companion_file(database, Companion.STOP)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as mouth, suppress(OSError, ValueError):
        mouth.bind("")  # an address of its own, made by the system, for the answer
        mouth.settimeout(patience_s)
        with _short(path) as address:
            mouth.sendto(_STOP, address)
        answer = mouth.recv(64)
        return int(answer.removeprefix(_STOPPING)) if answer.startswith(_STOPPING) else None
    return None


def _bound(path: Path) -> socket.socket:
    ear = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        ear.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        os.fchmod(ear.fileno(), _MODE)  # before the name exists, so that nobody comes in between
        with _short(path) as address:
            ear.bind(address)
        path.chmod(_MODE)  # what the umask took off
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


def _listen(ear: socket.socket, end: socket.socket, stop: Callable[[str], None]) -> None:
    while True:
        ready, _, _ = select.select([ear, end], [], [])
        if end in ready:
            return
        data, ancillary, _, sender = ear.recvmsg(64, socket.CMSG_SPACE(_CREDENTIALS.size))
        if data != _STOP:
            continue
        stop(_user(ancillary))
        if sender:
            with suppress(OSError):  # it no longer waits
                ear.sendto(_STOPPING + str(os.getpid()).encode(), socket.MSG_DONTWAIT, sender)


def _user(ancillary: list[tuple[int, int, bytes]]) -> str:
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, socket.SCM_CREDENTIALS):
            uid = _CREDENTIALS.unpack(data[: _CREDENTIALS.size])[1]
            with suppress(KeyError):
                return pwd.getpwuid(uid).pw_name
            return str(uid)
    return "?"
