"""Objects of a simulated device served in time: one request after the other, a turnaround, slow flash, faults."""

import heapq
import math
from collections import deque
from collections.abc import Callable
from typing import Protocol

from canopen.sdo import constants as sdo

from station.adapters.simulated_device.device_fault import InjectedFault
from station.adapters.simulated_device.object_server import ObjectServer, SdoRequest
from station.adapters.simulated_device.objects import SimulatedObjects
from station.adapters.simulated_device.sdo_faults import SdoFaults


class Agenda:
    """What is to be done when; things due at one instant are done in the order in which they were put in."""

    def __init__(self) -> None:
        self._heap: list[tuple[float, int, Callable[[], None]]] = []
        self._count = 0

    @property
    def next_s(self) -> float:
        """Instant of the next thing; infinity when there is none."""
        return self._heap[0][0] if self._heap else math.inf

    def at(self, due_s: float, action: Callable[[], None]) -> None:
        """Puts a deed on the agenda."""
        self._count += 1
        heapq.heappush(self._heap, (due_s, self._count, action))

    def run(self, now_s: float) -> None:
        """Does all that is due, and what becomes due by it."""
        while self._heap and self._heap[0][0] <= now_s:
            heapq.heappop(self._heap)[2]()

    def clear(self) -> None:
        """Forgets everything."""
        self._heap.clear()


class DeviceControl(Protocol):
    """What the server's faults and commands can do to the device."""

    @property
    def is_operational(self) -> bool:
        """Whether it sends its readings."""

    def send_answers(self, answers: tuple[bytes, ...], off: int = 0) -> None:
        """Sends answers now; off: by how much the node id in them is wrong."""

    def reset(self) -> None:
        """Starts again, as after NMT reset node."""

    def cut_power(self, back_after_s: float) -> None:
        """Loses power; it comes back after that time, or never for 0."""


class SdoService:
    """Serves requests in turn. turnaround_s: from request to answer; flash_s: how long a save or restore takes."""

    def __init__(
        self,
        objects: SimulatedObjects,
        server: ObjectServer,
        body: DeviceControl,
        agenda: Agenda,
        faults: SdoFaults,
        *,
        turnaround_s: float,
        flash_s: float,
    ) -> None:
        self._objects = objects
        self._server = server
        self._device_control = body
        self._agenda = agenda
        self._faults = faults
        self._turnaround_s = turnaround_s
        self._flash_s = flash_s
        self._waiting: deque[bytes] = deque()
        self._busy = False

    def reset(self) -> None:
        """Forgets requests and the transfer under way."""
        self._server.reset()
        self._waiting.clear()
        self._busy = False

    def take(self, data: bytes, now_s: float) -> None:
        """A request came in."""
        self._waiting.append(data)
        self._work(now_s)

    def _work(self, now_s: float) -> None:
        while self._waiting and not self._busy:
            self._serve(self._waiting.popleft(), now_s)

    def _serve(self, data: bytes, now_s: float) -> None:
        about = self._server.about(data)
        if cut := self._faults.fires("power-cut", about):
            self._device_control.cut_power(cut.seconds)
        elif self._faults.fires("reboot", about):
            self._device_control.reset()
        elif not self._unheard(about):
            answers = self._faults.spoil(self._answers(data, about), about, self._server)
            late = self._faults.fires("late", about)
            command, self._objects.command = self._objects.command, None
            due_s = now_s + self._turnaround_s + (late.seconds if late else 0.0)
            if command is not None:
                self._flash(command, about, answers, due_s)
            else:
                if answers:
                    self._agenda.at(due_s, self._sender(answers, about))
                if self._server.wants_restart():
                    self._agenda.at(due_s, self._device_control.reset)

    def _sender(self, answers: tuple[bytes, ...], about: SdoRequest) -> Callable[[], None]:
        """Sends the answers, under the node id that a fault may make another one."""
        off = int(self._faults.fires("other-id", about) is not None)
        return lambda: self._device_control.send_answers(answers, off)

    def _unheard(self, about: SdoRequest) -> bool:
        if unit := self._faults.fires("other-unit", about):
            place = self._objects.map.serial_object
            self._objects.replace((0x1018, 4) if place is None else place.address, unit.value)
        lost = about.segment and self._faults.fires("lost-segment", about) is not None
        return lost or self._faults.fires("deaf", about) is not None

    def _answers(self, data: bytes, about: SdoRequest) -> tuple[bytes, ...]:
        refusal = self._refusal(about)
        if refusal and data[0] != sdo.REQUEST_ABORTED:
            refused = self._server.refuse(data, refusal)
            return (refused,) if refused else ()
        return self._server.handle(data)

    def _refusal(self, about: SdoRequest) -> int:
        """Abort code of a request that a fault refuses; 0: none does."""
        if about.access == "write" and self._device_control.is_operational and self._faults.fires("only-idle", about):
            return sdo.ABORT_APPLICATION_DEVICE_STATE
        fault = self._faults.fires("refuse", about)
        return fault.code if fault else 0

    def _flash(self, command: str, about: SdoRequest, answers: tuple[bytes, ...], due_s: float) -> None:
        """Saves or notes the restore, then answers; other requests wait."""
        self._busy = True
        torn = self._faults.fires("save-torn", about) if command == "save" else None
        if torn is not None:
            self._agenda.at(due_s + self._flash_s / 2, lambda: self._tear(torn))
            return
        if command == "save" and self._faults.fires("save-fails", about):
            answers, command = (self._server.abort(sdo.ABORT_HARDWARE_ERROR),), "nothing"
        elif command == "save" and self._faults.fires("save-lies", about):
            command = "nothing"
        self._agenda.at(due_s + self._flash_s, lambda: self._finish(command, answers, due_s + self._flash_s))

    def _finish(self, command: str, answers: tuple[bytes, ...], now_s: float) -> None:
        if command == "save":
            self._objects.memory.store(self._faults.remembered(self._objects.snapshot(), self._objects.saved()))
        elif command == "restore":
            self._objects.restore_at_reset()
        self._device_control.send_answers(answers)
        self._busy = False
        self._work(now_s)

    def _tear(self, torn: InjectedFault) -> None:
        saved, wanted = self._objects.saved(), self._objects.snapshot()
        changed = [address for address, value in wanted.items() if saved.get(address) != value]
        first = {address: wanted[address] for address in changed[: len(changed) // 2]}
        self._objects.memory.store({**saved, **first})
        self._device_control.cut_power(torn.seconds)
