"""The faults of what serves a simulated device's objects: which request a fault meets, and what becomes of answers."""

from collections.abc import Sequence

from canopen.sdo import constants as sdo

from station.adapters.canopen.sdo_transfer import COMMAND_MASK
from station.adapters.simulated_device.device_fault import InjectedFault
from station.adapters.simulated_device.nonvolatile import SavedObjects, address_of
from station.adapters.simulated_device.object_server import ObjectServer, SdoRequest

#: These happen once unless `times` says otherwise.
_ONCE = frozenset({"reboot", "power-cut", "other-unit", "save-torn", "lost-segment"})
_SEGMENT_ANSWERS = (sdo.RESPONSE_SEGMENT_UPLOAD, sdo.RESPONSE_SEGMENT_DOWNLOAD)


class SdoFaults:
    """Counts what each fault meets; a fault acts from its `at`-th meeting on, `times` times."""

    def __init__(self, faults: Sequence[InjectedFault]) -> None:
        self._faults = tuple(faults)
        self._met = [0] * len(self._faults)
        self._previous: tuple[bytes, ...] = ()

    def fires(self, kind: str, about: SdoRequest) -> InjectedFault | None:
        """The fault of that kind that acts on this request; each call counts as a meeting."""
        acting = None
        for i, fault in enumerate(self._faults):
            if fault.kind == kind and fault.meets(about.index, about.sub, about.access):
                self._met[i] += 1
                times = fault.times or (1 if kind in _ONCE else 0)
                if self._met[i] >= fault.at and (not times or self._met[i] < fault.at + times):
                    acting = acting or fault
        return acting

    def spoil(self, answers: tuple[bytes, ...], about: SdoRequest, server: ObjectServer) -> tuple[bytes, ...]:
        """What is sent in place of these answers."""
        previous, self._previous = self._previous, answers or self._previous
        answers = tuple(self._spoilt(answer, about, server) for answer in answers)
        if len(answers) == 1 and self.fires("early", about):
            answers = (answers[0], server.of_next_object(answers[0]))
        if self.fires("stale", about):
            answers = previous + answers
        if self.fires("twice", about):
            answers = answers + answers
        return () if self.fires("silent", about) else answers

    def remembered(self, wanted: SavedObjects, before: SavedObjects) -> SavedObjects:
        """What a save keeps of the objects: those that a fault forgets stay as they were."""
        forgotten = [f for f in self._faults if f.kind == "forgets"]
        return {
            key: before.get(key, value) if any(f.meets(*address_of(key), "write") for f in forgotten) else value
            for key, value in wanted.items()
        }

    def _spoilt(self, answer: bytes, about: SdoRequest, server: ObjectServer) -> bytes:
        kind = answer[0] & COMMAND_MASK
        names_object = about.starts and server.of_other_object(answer, 0xFFFF) != answer
        if names_object and (fault := self.fires("wrong-object", about)):
            return server.of_other_object(answer, int(fault.value))
        if not about.starts and kind in _SEGMENT_ANSWERS and self.fires("wrong-toggle", about):
            return bytes([answer[0] ^ sdo.TOGGLE_BIT]) + answer[1:]
        return answer
