"""Readings of one node while they come in: every frame is decoded once, and any window is a view of what is decoded."""

from station.domain.can.decode import DecodedFrames, Samples, check_sequence, decode_frames
from station.domain.can.sensor_layout import SensorLayout
from station.domain.core.types import Frames

#: Before and after every time stamp, ns.
ALWAYS_NS, NEVER_NS = -(1 << 62), 1 << 62


class SampleDecoder:
    """Decodes the frames of `node` as they are added; what others sent is passed over."""

    def __init__(self, layout: SensorLayout, node: int) -> None:
        self._layout, self._node = layout, node
        self._parts = [decode_frames(Frames.empty(), layout, node)]

    def add(self, frames: Frames) -> None:
        """The next frames; they become the newest part."""
        self._parts.append(decode_frames(frames, self._layout, self._node))

    def newest(self) -> Samples:
        """What the last `add` brought."""
        return check_sequence(self._parts[-1], self._layout)

    def samples(self, from_ns: int = ALWAYS_NS, to_ns: int = NEVER_NS) -> Samples:
        """The readings in [from_ns, to_ns), checked as a sequence of their own, and every temperature so far."""
        window = DecodedFrames.join(self._parts).between(from_ns, to_ns)
        return check_sequence(window, self._layout)

    def recent(self, from_ns: int) -> Samples:
        """The readings from `from_ns` on, without looking at parts that are older."""
        first = len(self._parts) - 1
        while first > 0 and not _is_older(self._parts[first - 1], from_ns):
            first -= 1
        window = DecodedFrames.join(self._parts[first:]).between(from_ns, NEVER_NS)
        return check_sequence(window, self._layout)

    def forget(self, before_ns: int) -> None:
        """Lets go of parts that are older as a whole."""
        self._parts = [self._parts[0], *(part for part in self._parts[1:] if not _is_older(part, before_ns))]


def _is_older(part: DecodedFrames, from_ns: int) -> bool:
    return len(part.time_ns) > 0 and int(part.time_ns.max()) < from_ns
