"""Many frames per system call: recvmmsg into one preallocated buffer, read back as one numpy array."""

import ctypes
import errno
import os
import socket
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Array, Frames

#: From <asm-generic/socket.h>; Python names neither.
SO_TIMESTAMPNS, SO_RCVBUFFORCE, SO_MEMINFO = 35, 33, 55
#: struct can_frame of <linux/can.h>.
CAN_FRAME = np.dtype([("can_id", "=u4"), ("length", "u1"), ("pad", "u1", 3), ("data", "u1", 8)])
#: struct canfd_frame: the same head, and 64 bytes.
CANFD_FRAME = np.dtype([("can_id", "=u4"), ("length", "u1"), ("pad", "u1", 3), ("data", "u1", 64)])
#: One control message that holds a struct timespec of longs.
_STAMP = np.dtype([("size", np.uintp), ("level", "=i4"), ("type", "=i4"), ("s", "l"), ("ns", "l")])
_IOVEC = np.dtype([("base", np.uintp), ("size", np.uintp)])
_MSGHDR = np.dtype(
    [
        ("name", np.uintp),
        ("name_size", "=u4"),
        ("iov", np.uintp),
        ("iov_count", np.uintp),
        ("control", np.uintp),
        ("control_size", np.uintp),
        ("flags", "=i4"),
    ],
    align=True,
)
_MMSGHDR = np.dtype([("header", _MSGHDR), ("received", "=u4")], align=True)


class Receiver:
    """Empties a datagram socket whose datagrams are struct can_frame, or canfd_frame where `fd`; nothing is allocated
    per frame.

    The socket keeps the kernel's receive time (SO_TIMESTAMPNS, CLOCK_REALTIME), to the nanosecond.
    """

    def __init__(self, sock: socket.socket, batch: int = 2048, *, fd: bool = False) -> None:
        self._sock = sock
        self._batch = batch
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._frames = np.zeros(batch, CANFD_FRAME if fd else CAN_FRAME)
        # The same memory column by column: copying from the packed structure costs five times as much.
        self._ids, self._lengths, self._data = (self._frames.view(k).reshape(batch, -1) for k in ("u4", "u1", "u8"))
        self._stamps = np.zeros(batch, _STAMP)
        self._iovecs = np.zeros(batch, _IOVEC)
        self._iovecs["base"] = _addresses(self._frames)
        self._iovecs["size"] = self._frames.itemsize
        self._messages = np.zeros(batch, _MMSGHDR)
        header = self._messages["header"]
        header["iov"] = _addresses(self._iovecs)
        header["iov_count"] = 1
        header["control"] = _addresses(self._stamps)
        header["control_size"] = _STAMP.itemsize
        sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)

    def take(self) -> Frames:
        """Up to one batch of what is waiting, without waiting. OSError as the socket reports it."""
        count = self.fill()
        if count == 0:
            return Frames.empty()
        stamps, lengths = self._stamps[:count], self._lengths[:count, 4].copy()
        # Classic frames leave bytes of an earlier FD frame behind them: only what they hold is taken.
        words = 1 if lengths.max() <= 8 else 8
        return Frames(
            stamps["s"] * np.int64(1_000_000_000) + stamps["ns"],
            self._ids[:count, 0].copy(),
            lengths,
            _cleared(self._data[:count, 1 : 1 + words].copy().view(np.uint8), lengths),
        )

    def fill(self) -> int:
        """One system call: how many frames now stand at the front of the buffer."""
        count = int(
            self._libc.recvmmsg(
                self._sock.fileno(), ctypes.c_void_p(self._messages.ctypes.data), self._batch, socket.MSG_DONTWAIT, None
            )
        )
        if count >= 0:
            return count
        number = ctypes.get_errno()
        if number in (errno.EAGAIN, errno.EINTR):
            return 0
        raise OSError(number, os.strerror(number))

    @property
    def batch(self) -> int:
        """How many frames one call takes at most."""
        return self._batch


def _cleared(data: NDArray[np.uint8], lengths: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Payloads (n, 8 or 64) with zeros beyond each one's length; the kernel leaves none behind in classic frames."""
    if data.shape[1] == 8 or lengths.min() == 64:
        return data
    data[np.arange(64) >= lengths[:, None]] = 0
    return data


def _addresses(array: Array) -> Any:
    """Address of each element."""
    return array.ctypes.data + array.itemsize * np.arange(len(array), dtype=np.uintp)
