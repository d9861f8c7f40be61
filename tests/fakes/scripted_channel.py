"""A channel that plays a script of (sent, answered) lines in virtual time; what was not played fails the test."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from station.domain.core.types import Frames

#: One line: the frame that must be sent (None: nothing, time must run out), and (delay s, frame) of each answer.
Line = tuple[str | None, Sequence[str | tuple[float, str]]]


class ScriptedChannel:
    """Implements ports.bus.Channel and ports.clock.Clock for one node: requests go to 0x600, answers come from 0x580,
    or to and from the identifiers of `ids`.

    Frames are written as hex with spaces. An answer without a delay comes at once.
    """

    def __init__(self, node: int, *script: Line, ids: tuple[int, int] | None = None) -> None:
        self._request_id, self._response_id = ids or (0x600 + node, 0x580 + node)
        self._script = deque(script)
        self._coming: list[tuple[float, int, bytes]] = []
        self._now_s = 100.0

    def send(self, can_id: int, data: bytes) -> None:
        """Must be the next line's frame."""
        assert can_id == self._request_id, f"sent to 0x{can_id:03X}"
        assert self._script, f"sent {data.hex(' ')} after the end of the script"
        sent, answers = self._script.popleft()
        assert data.hex(" ") == sent, f"sent {data.hex(' ')}, the script says {sent}"
        for answer in answers:
            delay_s, frame = (0.0, answer) if isinstance(answer, str) else answer
            self.come(delay_s, self._response_id, bytes.fromhex(frame))

    def come(self, delay_s: float, can_id: int, data: bytes) -> None:
        """Lets a frame come after a delay."""
        self._coming.append((self._now_s + delay_s, can_id, data))
        self._coming.sort(key=lambda line: line[0])

    def receive(self, timeout_s: float) -> Frames:
        """What has come; else time jumps to the next frame, or by `timeout_s`."""
        if self._coming and self._coming[0][0] <= self._now_s + timeout_s:
            self._now_s = max(self._now_s, self._coming[0][0])
        else:
            self._now_s += timeout_s
        here = [line for line in self._coming if line[0] <= self._now_s]
        self._coming = self._coming[len(here) :]
        payload = b"".join(data.ljust(8, b"\0") for _, _, data in here)
        return Frames(
            np.array([round(t * 1e9) for t, _, _ in here], np.int64),
            np.array([can_id for _, can_id, _ in here], np.uint32),
            np.array([len(data) for _, _, data in here], np.uint8),
            np.frombuffer(payload, np.uint8).reshape(len(here), 8),
        )

    def drops(self) -> int:
        """None."""
        return 0

    def close(self) -> None:
        """Every line must have been played."""
        assert not self._script, f"not played: {list(self._script)}"

    def monotonic_s(self) -> float:
        """Script time."""
        return self._now_s

    def epoch_ns(self) -> int:
        """Script time in ns."""
        return round(self._now_s * 1e9)

    def sleep(self, duration_s: float) -> None:
        """Lets script time pass."""
        self._now_s += duration_s
