"""One device on the bus: object access as calls with a time-out and a result, and its life cycle."""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Protocol

from station.errors import DeviceRefused

#: Longer texts are cut.
LONGEST_TEXT = 80


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity objects as read: 0x1000, 0x1018:1–4, 0x1008, 0x1009, 0x100A."""

    device_type: int
    vendor: int
    product: int
    revision: int
    serial: int
    name: str
    hardware: str
    software: str


@dataclass(frozen=True, slots=True)
class Emergency:
    """An EMCY message: error code, error register, five bytes of the maker's own."""

    time_ns: int
    code: int
    register: int
    detail: bytes


class Device(Protocol):
    """A CANopen node. Errors: DeviceSilent on time-out, DeviceRefused with the abort code as a sentence."""

    @property
    def node(self) -> int:
        """Node id, 1–127."""

    def identify(self, required: Collection[tuple[int, int]] = ((0x1000, 0),)) -> Identity:
        """Reads the identity objects; one that is not among the `asked` and is refused reads as 0 or ''."""

    def upload(self, index: int, sub: int, timeout_s: float | None = None) -> bytes:
        """Raw value of an object (expedited or segmented; block where the device offers it)."""

    def download(self, index: int, sub: int, data: bytes, timeout_s: float | None = None) -> None:
        """Writes an object. Never repeated: on a time-out the node is quarantined, drained, and must be read back."""

    def nmt(self, command: str) -> None:
        """Sends start, stop, pre-operational, reset-node or reset-communication to this node."""

    def wait_boot_up(self, timeout_s: float) -> None:
        """Waits for the boot-up message that follows the last reset; it may have come before this call."""

    def state(self) -> str:
        """NMT state last seen in a heartbeat: operational, pre-operational, stopped, booting or unknown."""

    def heartbeat_age_s(self) -> float:
        """Seconds since the last heartbeat or boot-up; infinity when there was none."""

    def heartbeats(self) -> int:
        """Heartbeats and boot-up messages seen so far."""

    def emergencies(self) -> tuple[Emergency, ...]:
        """EMCY messages since the last call, oldest first; taking them empties the list."""

    def boot_ups(self) -> int:
        """Boot-up messages seen so far: a rise without a reset of ours means the device rebooted by itself."""


def read_identity(upload: Callable[[int, int], bytes], required: Collection[tuple[int, int]]) -> Identity:
    """The identity objects by reading them; one that is not among the `asked` and is refused reads as 0 or ''."""

    def read(index: int, sub: int) -> bytes:
        try:
            return upload(index, sub)
        except DeviceRefused:
            if (index, sub) in required:
                raise
            return b""

    def number(index: int, sub: int) -> int:
        return int.from_bytes(read(index, sub), "little")

    def text(index: int) -> str:
        found = read(index, 0).decode("latin-1").partition("\0")[0]
        return "".join(c for c in found if c.isprintable())[:LONGEST_TEXT]

    return Identity(
        device_type=number(0x1000, 0),
        vendor=number(0x1018, 1),
        product=number(0x1018, 2),
        revision=number(0x1018, 3),
        serial=number(0x1018, 4),
        name=text(0x1008),
        hardware=text(0x1009),
        software=text(0x100A),
    )
