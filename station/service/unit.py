"""One attempt while it goes on: what is known of the unit so far, and how it ends."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from station.domain.capture.visit import Visit
from station.domain.core.types import Floats, NestAssignment, Outcome, Reason
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.product.product import decode_serial
from station.domain.product.sdo_codes import address
from station.domain.product.sending_pdo import SendingPdo
from station.domain.run.progress import UnitResult
from station.domain.run.unit_state import HOLDS_NEW, UNIT_STATES, UnitState
from station.errors import ForeignMaster, StationError, UnitFault, WrongUnit
from station.messages import Message
from station.ports.device import Device, Identity
from station.ports.foreign_traffic import ForeignTraffic
from station.service.station import Job

Address = tuple[int, int]

#: So many heartbeats may be late before the device counts as dead.
MAX_LATE_HEARTBEATS = 3


@dataclass(frozen=True, slots=True)
class RunSetting:
    """An object that is set for the run: as it was found, as it must be (None: recorded only), whether the verification
    needs it too, and whether a device that refuses it may go on."""

    address: Address
    name: str
    found: bytes
    wanted: bytes | None
    lasts: bool = True
    may_refuse: bool = False


@dataclass(slots=True, eq=False)
class Unit:
    """Working state of one attempt. old: raw values of the objects as the device came; settings: what is set for the
    run, in that order; switched: whether any of it, or the output, may not be as it was found; found_state: NMT state
    before the station changed it, '' while it has not; sync_every: SYNCs to a reading, 0: it needs none.

    noise in the recipe's unit; heartbeat_s: 0 for none; heard: heartbeats until the first visit began, and when
    that was, s; emergency: an error that the device has reported and not
    taken back; last_shown: mean reading (3) and truth (3) of the last good visit.
    """

    seat: NestAssignment
    attempt: str
    device: Device
    began_s: float
    state: UnitState = UnitState.SEATED
    boot_ups: int = 0
    identity: Identity | None = None
    old: Mapping[Address, bytes] = field(default_factory=dict)
    settings: tuple[RunSetting, ...] = ()
    switched: bool = False
    found_state: str = ""
    sync_every: int = 0
    pdos: tuple[SendingPdo, ...] = ()
    heartbeat_s: float = 0.0
    heard: tuple[int, float] | None = None
    emergency: Message | None = None
    last_shown: tuple[Floats, Floats] | None = None
    noise: float | None = None
    temperature_degC: float | None = None
    visits: list[Visit] = field(default_factory=list)
    verify_visits: list[Visit] = field(default_factory=list)
    fit: CalibrationResult | None = None
    verification: Mapping[str, Any] | None = None
    reasons: list[Reason] = field(default_factory=list)
    result: UnitResult | None = None

    @property
    def alive(self) -> bool:
        """Whether the attempt still goes on."""
        return self.state is not UnitState.CLOSED

    @property
    def written(self) -> bool:
        """Whether the new coefficients are saved and were read back after a reset."""
        return self.state in HOLDS_NEW

    @property
    def verified(self) -> bool:
        """Whether its own output was right afterwards."""
        return self.state is UnitState.VERIFIED

    @property
    def name(self) -> str:
        """How sentences call it."""
        return f"unit {self.seat.serial} in nest {self.seat.nest}"

    @property
    def label(self) -> Message:
        """How messages name it."""
        return Message("unit-in-nest", serial=self.seat.serial, nest=self.seat.nest)

    @property
    def heartbeat_limit_s(self) -> float:
        """Age of the last heartbeat, s, from which the device counts as dead; infinite where it sends none."""
        return MAX_LATE_HEARTBEATS * self.heartbeat_s or math.inf

    def enter(self, state: UnitState) -> None:
        """Goes on to `state`. Errors: StationFault where the table allows no such step."""
        self.state = UNIT_STATES.follow(self.state, state)

    def end(self, outcome: Outcome, duration_s: float) -> UnitResult:
        """Ends the attempt; the first end counts."""
        if self.result is None:
            self.result = UnitResult(
                seat=self.seat,
                attempt=self.attempt,
                outcome=outcome,
                reasons=tuple(self.reasons),
                fit=self.fit,
                written=self.written,
                verified=self.verified,
                noise=self.noise,
                duration_s=duration_s,
                verification=self.verification,
            )
            self.enter(UnitState.CLOSED)
        return self.result


def reason_of(error: StationError) -> Reason:
    """An error as a reason of the record: wrong-product, device-silent, …"""
    name = type(error).__name__
    check = "".join(f"-{c.lower()}" if c.isupper() else c for c in name).lstrip("-")
    return Reason(error.message, check=check)


def check_same_unit(unit: Unit, job: Job) -> None:
    """Reads the serial again; WrongUnit when another unit sits there now than at the start. Nothing where the device
    keeps none."""
    place = job.product.map.serial_object
    if place is None or place.address not in unit.old:
        return
    now = decode_serial(place, unit.device.upload(*place.address))
    before = decode_serial(place, unit.old[place.address])
    if now != before:
        raise WrongUnit("unit-swapped", unit=unit.label, read=now, expected=before)


def check_not_rebooted(unit: Unit, when: Message) -> None:
    """UnitFault when the device restarted by itself since the last reset of ours."""
    if unit.device.boot_ups() != unit.boot_ups:
        raise UnitFault("unit-restarted", unit=unit.label, when=when)


def check_no_foreign_master(unit: Unit, foreign: ForeignTraffic) -> None:
    """ForeignMaster when somebody else has written to the device or switched it since the load began."""
    commands = foreign.commands(unit.seat.node)
    if not commands:
        return
    first = commands[0]
    if first.is_write:
        raise ForeignMaster("foreign-write", unit=unit.label, object=address(*first.written), count=len(commands))
    raise ForeignMaster("foreign-nmt", unit=unit.label, command=f"0x{first.data[0]:02X}", count=len(commands))
