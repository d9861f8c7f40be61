"""A PLC turns the fixture: the station offers it an orientation by Modbus TCP, and it moves on a second word."""

from collections.abc import Mapping
from typing import Annotated

import numpy as np
from pydantic import Field

from station.adapters.modbus import ModbusRegisters, PlcLink, load_map
from station.adapters.simulated_plc import MemoryRegisters, SimulatedPlc
from station.domain.cell import plc_view
from station.domain.cell.plc_view import MoveState, PlcView
from station.domain.core import rotation
from station.domain.core.types import Floats
from station.domain.recipe.fields import NotNegative, Positive, StrictModel
from station.domain.recipe.moves import turn_s
from station.domain.recipe.plan import PlannedVisit
from station.errors import PlcFault, PositionerFault
from station.messages import Message
from station.ports.clock import Clock
from station.ports.positioner import MeasuredPose

Quaternion = tuple[int, int, int, int]

#: What must be true before and during a move, with the sentence where it is not.
SAFE: Mapping[str, str] = {
    "safety-ok": "plc-safety-tripped",
    "door-closed": "plc-door-open",
    "clamps-closed": "plc-clamps-open",
}


class PlcPositioner:
    """Offers a target under a number, compares the echo, gives the go, and watches until it stands there.

    host left out: a simulated PLC in this process, which turns nothing.

    positioner: {kind: plc, host: 192.168.0.10, map: cell}
    """

    by_hand = False

    class Settings(StrictModel):
        """host, port, map: the PLC and its registers (`cells/NAME.yaml`); answer_s: longest for one answer; echo_s:
        longest until it echoes a target or starts; tolerance_deg: of its own encoder about the target; poll_s: between
        two looks; speed_deg_s, acceleration_deg_s2: of the drive, for estimates.
        """

        host: Annotated[str, Field(max_length=253, pattern=r"^[\w.:\-]*$")] = ""
        port: Annotated[int, Field(ge=1, le=65535)] = 502
        map: Annotated[str, Field(max_length=4096, pattern=r"^[^\x00-\x1f\x7f]*$")] = "cell"
        answer_s: Positive = 0.3
        echo_s: Positive = 1.0
        poll_s: Positive = 0.02
        tolerance_deg: Positive = 0.5
        overhead_s: NotNegative = 0.03
        speed_deg_s: Positive = 90.0
        acceleration_deg_s2: Positive = 180.0

    def __init__(self, settings: "PlcPositioner.Settings", clock: Clock, link: PlcLink | None = None) -> None:
        self._settings, self._clock, self._opened = settings, clock, link
        self._number = 0

    @property
    def turns_nothing(self) -> bool:
        """Whether it is simulated."""
        return not self._settings.host

    @property
    def _link(self) -> PlcLink:
        if self._opened is None:
            self._opened = self._open()
        return self._opened

    def _open(self) -> PlcLink:
        given = self._settings
        plc = load_map(given.map)
        if not given.host:
            simulated = SimulatedPlc(plc, given.speed_deg_s, given.acceleration_deg_s2)
            return PlcLink(MemoryRegisters(simulated, self._clock), plc, self._clock)
        return PlcLink(ModbusRegisters(given.host, given.port, plc.device, given.answer_s), plc, self._clock)

    def move(self, stop: PlannedVisit, timeout_s: float) -> None:
        """Turns to the stop. Errors: PositionerFault; the PLC is then told to stop."""
        self._travel(stop.nest, timeout_s, Message("place-position", position=stop.position))

    def park(self, timeout_s: float) -> None:
        """Turns to the identity, where units are loaded, unless it stands there: a cell without a load has its clamps
        open, and nothing may turn then. Errors: PositionerFault.
        """
        if not self._is_parked():
            self._travel(np.eye(3), timeout_s, Message("place-parking"))

    def where(self) -> MeasuredPose | None:
        """As the PLC measures it. Errors: PositionerFault."""
        try:
            attitude = self._link.begin().attitude()
            return None if attitude is None else MeasuredPose(attitude)
        except PlcFault as fault:
            raise PositionerFault(fault.message) from fault

    def estimate_s(self, origin: PlannedVisit | None, stop: PlannedVisit) -> float:
        """Time of the move by the trapezium of speed, and that of the handshake."""
        start = np.eye(3) if origin is None else origin.nest
        angle = np.degrees(np.linalg.norm(rotation.to_vector(stop.nest @ start.T)))
        turn = turn_s(np.array(angle), self._settings.speed_deg_s, self._settings.acceleration_deg_s2)
        return float(turn) + self._settings.overhead_s

    def close(self) -> None:
        """Ends the connection; the next move opens another."""
        self._link.close()

    def _is_parked(self) -> bool:
        try:
            view = self._link.begin()
        except PlcFault as fault:
            raise PositionerFault(fault.message) from fault
        off_deg = plc_view.angle_between_deg(view.actual, plc_view.quaternion_of(np.eye(3)))
        return "in-position" in view.status and "moving" not in view.status and off_deg <= self._settings.tolerance_deg

    def _travel(self, goal: Floats, timeout_s: float, place: Message) -> None:
        until_s = self._clock.monotonic_s() + timeout_s
        target = plc_view.quaternion_of(goal)
        try:
            before = self._offer(target)
            try:
                self._go(target, before, until_s)
            except BaseException:  # a stop request too: nothing may move that nobody watches
                self._halt()
                raise
        except PlcFault as fault:
            raise PositionerFault(fault.message) from fault
        except TimeoutError:
            raise PositionerFault("positioner-timed-out", place=place, timeout_s=timeout_s) from None

    def _offer(self, target: Quaternion) -> PlcView:
        """Target and number, until the PLC echoes both; nothing moves yet. The last view."""
        before = self._link.begin()
        if fault := plc_view.unsafe(before, SAFE):
            raise PlcFault(fault)
        if "moving" in before.status:
            raise PlcFault("plc-moves-unasked")
        self._number = plc_view.next_number(before.move_echo)
        self._link.beat()
        self._link.write_checked(target=target)
        self._link.write_checked(move=self._number)
        late_s = self._clock.monotonic_s() + self._settings.echo_s
        while True:
            view = self._link.view()
            self._check(view, before)
            if view.move_echo == self._number and view.move_state == MoveState.REFUSED:
                raise PlcFault("plc-refused", code=view.fault)
            if view.move_echo == self._number and view.move_state == MoveState.OFFERED:
                if view.target_echo != target:
                    raise PlcFault("plc-echo-differs")
                return view
            if self._clock.monotonic_s() > late_s:
                raise PlcFault("plc-no-echo", number=self._number, echo=view.move_echo, limit_s=self._settings.echo_s)
            self._wait()

    def _go(self, target: Quaternion, offered: PlcView, until_s: float) -> None:
        """The word to move, bound to the PLC's own time: an old one that arrives late moves nothing."""
        self._link.write(go_beat=offered.heartbeat, go=self._number)
        late_s = self._clock.monotonic_s() + self._settings.echo_s
        while True:
            view = self._link.view()
            self._check(view, offered)
            if view.target_echo != target:
                raise PlcFault("plc-target-changed")
            if view.move_echo != self._number:
                raise PlcFault("plc-echo-changed", number=self._number, echo=view.move_echo)
            if view.move_state == MoveState.DONE:
                return self._check_arrival(view, target)
            if view.move_state not in (MoveState.OFFERED, MoveState.MOVING):
                raise PlcFault("plc-stopped", code=view.fault)
            now_s = self._clock.monotonic_s()
            if view.move_state == MoveState.OFFERED and now_s > late_s:
                raise PlcFault("plc-not-started", limit_s=self._settings.echo_s)
            if now_s > until_s:
                raise TimeoutError
            self._wait()

    def _check(self, view: PlcView, before: PlcView) -> None:
        """What may not change between the offer and the arrival."""
        if view.starts != before.starts:
            raise PlcFault("plc-restarted")
        if fault := plc_view.unsafe(view, SAFE):
            raise PlcFault(fault)
        if gone := before.present - view.present:
            raise PlcFault("plc-part-gone", places=[place + 1 for place in sorted(gone)])

    def _check_arrival(self, view: PlcView, target: Quaternion) -> None:
        off_deg = plc_view.angle_between_deg(view.actual, target)
        if "in-position" not in view.status or "moving" in view.status or off_deg > self._settings.tolerance_deg:
            raise PlcFault("plc-done-elsewhere", off_deg=off_deg, limit_deg=self._settings.tolerance_deg)

    def _wait(self) -> None:
        self._clock.sleep(self._settings.poll_s)
        self._link.beat()

    def _halt(self) -> None:
        """Best effort: a PLC that is not reached stops by itself, for want of our heartbeat."""
        try:
            self._link.write(stop=self._number)
        except PlcFault:
            self._link.close()
