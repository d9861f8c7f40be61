"""Hears requests and NMT commands on the bus beside the station's own: implements station.ports.foreign_traffic."""

import threading
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

from station.domain.core.types import REMOTE
from station.errors import BusFault
from station.ports.bus import Bus
from station.ports.foreign_traffic import ForeignCommand

#: SDO client command specifiers (upper three bits) that begin a write: download and block download (CiA 301, 7.2.4.3).
_WRITES = (1, 6)
#: NMT commands that change a node that is measured: stop, pre-operational, reset node, reset communication.
_NMT = (2, 128, 129, 130)
_SDO, _NMT_ID = 0x600, 0x000
#: Own frames after which their echoes are taken from the channel: far fewer than a socket's buffer holds.
_SORT_EVERY = 32
#: An adapter that does not show the station its own frames leaves them here; so many are enough to recognise an echo.
_MAX_OWN = 4096


Address = tuple[int, int]


def sdo_written(data: bytes) -> Address | None:
    """The object that an SDO request begins to write; None when it writes none."""
    if len(data) != 8 or data[0] >> 5 not in _WRITES:
        return None
    return int.from_bytes(data[1:3], "little"), data[3]


class ForeignTrafficWatch:
    """A service channel of its own that hears commands to `nodes`. request_ids: where requests to a node do not come
    under SDO's identifier; written: the object that a request writes. `sent` is told of each frame the station sends,
    before it leaves; what is heard and was not sent is somebody else's. May be called from several threads."""

    def __init__(
        self,
        bus: Bus,
        nodes: Sequence[int],
        request_ids: Mapping[int, int] | None = None,
        written: Callable[[bytes], Address | None] = sdo_written,
    ) -> None:
        self._request_ids = {node: _SDO + node for node in nodes} if request_ids is None else dict(request_ids)
        self._channel = bus.service((_NMT_ID, *self._request_ids.values()))
        self._written = written
        self._own: Counter[tuple[int, bytes]] = Counter()
        self._heard: list[ForeignCommand] = []
        self._unsorted = 0
        self._lock = threading.Lock()

    def sent(self, can_id: int, data: bytes) -> None:
        """The station is about to send this frame."""
        if can_id != _NMT_ID and can_id not in self._request_ids.values():
            return
        with self._lock:
            self._unsorted += 1
            if self._unsorted >= _SORT_EVERY:
                self._sort()
            if len(self._own) >= _MAX_OWN:
                self._own.clear()
            self._own[can_id, bytes(data)] += 1

    def commands(self, node: int) -> tuple[ForeignCommand, ...]:
        """Foreign commands to this node since `restart`, oldest first."""
        with self._lock:
            self._sort()
            return tuple(c for c in self._heard if self._is_to(c, node))

    def restart(self) -> None:
        """Forgets what was heard: another load begins."""
        with self._lock:
            self._sort()
            self._heard.clear()

    def _sort(self) -> None:
        """Takes what came and leaves out what the station sent."""
        self._unsorted = 0
        try:
            frames = self._channel.receive(0.0)
        except BusFault:
            return  # whoever waits for an answer reports it
        for time_ns, can_id, length, data in zip(
            frames.time_ns.tolist(), frames.can_id.tolist(), frames.length.tolist(), frames.data, strict=True
        ):
            payload = data[:length].tobytes()
            key = can_id, payload
            if self._own[key] > 0:
                self._own[key] -= 1
                if not self._own[key]:
                    del self._own[key]
            elif not can_id & REMOTE and (at := self._changed(can_id, payload)) is not None:
                self._heard.append(ForeignCommand(time_ns, can_id, payload, at))

    def _changed(self, can_id: int, data: bytes) -> Address | None:
        """What a device that takes this command may hold otherwise afterwards; of NMT (0, 0), of any other None."""
        if can_id == _NMT_ID:
            return (0, 0) if len(data) >= 2 and data[0] in _NMT else None
        return self._written(data)

    def _is_to(self, command: ForeignCommand, node: int) -> bool:
        if command.is_write:
            return command.can_id == self._request_ids.get(node)
        return command.data[1] in (0, node)
