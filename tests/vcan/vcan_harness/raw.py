"""A bare CAN_RAW socket for tests: no library between the test and the kernel."""

import socket
import struct
from types import TracebackType
from typing import Self

_FRAME = struct.Struct("=IB3x8s")
_SO_MEMINFO, _DROPS = 55, 8


class RawSocket:
    """Bound to one interface. Frames are (can_id with flag bits, payload)."""

    def __init__(self, interface: str, buffer_bytes: int | None = None) -> None:
        self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        if buffer_bytes is not None:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer_bytes)
        self._socket.bind((interface,))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._socket.close()

    def send(self, can_id: int, data: bytes) -> None:
        """Sends one classic frame; an OSError is the kernel's own."""
        self._socket.send(_FRAME.pack(can_id, len(data), data))

    def receive(self, timeout_s: float = 5.0) -> tuple[int, bytes]:
        """The next frame. Errors: TimeoutError, OSError; BlockingIOError when `timeout_s` is 0."""
        self._socket.settimeout(timeout_s)
        can_id, length, data = _FRAME.unpack(self._socket.recv(_FRAME.size))
        return can_id, data[:length]

    def waiting(self) -> list[tuple[int, bytes]]:
        """Every frame in the buffer now."""
        frames = []
        while True:
            try:
                frames.append(self.receive(0.0))
            except BlockingIOError:
                return frames

    def drops(self) -> int:
        """Frames that the kernel has dropped on this socket (SO_MEMINFO)."""
        return int(struct.unpack("9I", self._socket.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, 36))[_DROPS])
