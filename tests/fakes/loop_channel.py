"""Two ends of a wire inside this process, in real time and safe between threads."""

import queue
import time

import numpy as np

from station.domain.core.types import Frames


class LoopChannel:
    """Implements ports.bus.Endpoint: what one end sends, the other receives."""

    def __init__(self, out: "queue.Queue[tuple[int, bytes]]", coming: "queue.Queue[tuple[int, bytes]]") -> None:
        self._out, self._coming = out, coming

    @classmethod
    def pair(cls) -> "tuple[LoopChannel, LoopChannel]":
        """Both ends."""
        one: queue.Queue[tuple[int, bytes]] = queue.Queue()
        other: queue.Queue[tuple[int, bytes]] = queue.Queue()
        return cls(one, other), cls(other, one)

    def send(self, can_id: int, data: bytes) -> None:
        """One frame."""
        self._out.put((can_id, data))

    def send_many(self, frames: Frames) -> None:
        """Frames one after the other."""
        for can_id, length, data in zip(frames.can_id.tolist(), frames.length.tolist(), frames.data, strict=True):
            self.send(can_id, data[:length].tobytes())

    def receive(self, timeout_s: float) -> Frames:
        """One frame, or none in time."""
        try:
            can_id, data = self._coming.get(timeout=timeout_s) if timeout_s > 0 else self._coming.get_nowait()
        except queue.Empty:
            return Frames.empty()
        return Frames(
            np.array([time.time_ns()], np.int64),
            np.array([can_id], np.uint32),
            np.array([len(data)], np.uint8),
            np.frombuffer(data.ljust(8, b"\0"), np.uint8).reshape(1, 8),
        )

    def wait_for(self, can_id: int, timeout_s: float = 10.0) -> bytes:
        """Payload of the next frame with this identifier. Errors: TimeoutError."""
        deadline_s = time.monotonic() + timeout_s
        while time.monotonic() < deadline_s:
            frames = self.receive(0.5)
            if len(frames) and int(frames.can_id[0]) == can_id:
                return frames.data[0, : int(frames.length[0])].tobytes()
        raise TimeoutError(f"0x{can_id:03X}: not within {timeout_s:g} s")

    def drops(self) -> int:
        """None."""
        return 0

    def close(self) -> None:
        """Nothing to close."""
