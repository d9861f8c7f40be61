"""A recorded CAN log in the place of a bus: the same frames, as fast as they can be read."""

from collections.abc import Iterator
from pathlib import Path

from station.adapters.bus._filter import accepted_mask
from station.adapters.bus._logs import read_blocks
from station.domain.core.types import Frames
from station.domain.recipe.fields import StrictModel
from station.errors import BusFault, LogError
from station.ports.bus import Repeated
from station.ports.clock import Clock


class ReplayBus:
    """A log as a bus, `channel` its file. Every channel reads the log from its start; time is the log's own, no call
    waits.

    Errors: LogError when the log cannot be read.
    """

    interface_of_kernel = False
    without_units = False

    class Settings(StrictModel):
        """No options."""

    @classmethod
    def on_a_wire(cls, _channel: str) -> bool:
        """A recording moves nobody."""
        return False

    def __init__(self, path: Path, channel: str | None = None) -> None:
        self._path = path
        self._channel = channel
        self._channels: list[_Channel] = []
        if next(read_blocks(path, channel), None) is None:
            raise LogError("recording-without-frames", file=str(path))

    @classmethod
    def open(cls, channel: str, _clock: Clock, _settings: Settings) -> "ReplayBus":
        """The log in the file of that name."""
        return cls(Path(channel))

    @property
    def name(self) -> str:
        """The log's file name."""
        return self._path.name

    def stream(self, can_ids: tuple[int, ...]) -> "_Channel":
        """The log's frames with these ids (none: all), and its error frames."""
        return self._open(can_ids, errors=True)

    def service(self, can_ids: tuple[int, ...]) -> "_Channel":
        """The log's frames with these ids (none: all), without error frames."""
        return self._open(can_ids, errors=False)

    def repeat(self, can_id: int, data: bytes, period_s: float) -> Repeated:
        """A recording cannot be changed: BusFault."""
        del period_s
        raise BusFault("recording-takes-no-frames", bus=self.name, can_id=can_id, size=len(data))

    def state(self) -> str:
        """Unknown: a log does not keep the controller's state; its error frames tell."""
        return "unknown"

    def counters(self) -> None:
        """None: a log does not keep them."""
        return

    def close(self) -> None:
        """Closes every channel opened here."""
        for channel in self._channels:
            channel.close()
        self._channels.clear()

    def _open(self, can_ids: tuple[int, ...], *, errors: bool) -> "_Channel":
        channel = _Channel(self.name, read_blocks(self._path, self._channel), can_ids, errors=errors)
        self._channels.append(channel)
        return channel


class _Channel:
    """One reading of the log, block by block."""

    def __init__(self, name: str, blocks: Iterator[Frames], can_ids: tuple[int, ...], *, errors: bool) -> None:
        self._name = name
        self._blocks: Iterator[Frames] | None = blocks
        self._can_ids = can_ids
        self._errors = errors

    def send(self, can_id: int, data: bytes) -> None:
        """A recording cannot be changed: BusFault."""
        raise BusFault("recording-takes-no-frames", bus=self._name, can_id=can_id, size=len(data))

    def receive(self, timeout_s: float) -> Frames:
        """The next block that holds frames for this channel; none at the end. Never waits: `timeout_s` is no matter."""
        del timeout_s
        if self._blocks is None:
            raise BusFault("channel-closed", bus=self._name)
        for block in self._blocks:
            mine = accepted_mask(block, self._can_ids, errors=self._errors)
            if mine.any():
                return block[mine]
        return Frames.empty()

    def drops(self) -> int:
        """None: what a recording lost shows in the frame counters only."""
        return 0

    def close(self) -> None:
        """Ends the reading; twice is harmless."""
        self._blocks = None
