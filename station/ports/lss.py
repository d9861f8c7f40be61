"""Layer setting services (CiA 305): node ids and bit timing given to devices that have none of their own."""

from dataclasses import dataclass
from typing import Protocol

#: The node id of a device that has none.
UNCONFIGURED = 0xFF


@dataclass(frozen=True, slots=True)
class LssIdentity:
    """0x1018:1–4: no two devices in the world have the same."""

    vendor: int
    product: int
    revision: int
    serial: int

    @property
    def numbers(self) -> tuple[int, int, int, int]:
        """Vendor, product, revision and serial, as LSS asks for them."""
        return self.vendor, self.product, self.revision, self.serial


class LssMaster(Protocol):
    """The one LSS master of a bus. A device that `select` or `scan` found is configured until `release`.

    Errors of all: BusFault when two devices answer where one may; DeviceSilent; UnitFault with the device's code.
    """

    def release(self) -> None:
        """Leaves every device to its work (switch state global); the new node id of a fresh one becomes active."""

    def holds_any(self) -> bool:
        """Whether a device is still being configured, as a master that was killed leaves it."""

    def select(self, identity: LssIdentity) -> bool:
        """Selects the device with this identity, proves that it is alone; False where none answers."""

    def scan(self, hint: LssIdentity | None = None) -> LssIdentity | None:
        """Finds and selects one device without a node id; None where there is none. hint: vendor, product and revision
        that it probably has, which spares 96 of 128 questions."""

    def inquire(self) -> LssIdentity:
        """Identity of the selected device."""

    def node_id(self) -> int:
        """Active node id of the selected device; 255: none."""

    def configure_node(self, node: int) -> None:
        """Gives the selected device a node id (1–127, or 255: none), not yet active and not yet stored."""

    def configure_bit_rate(self, kbit_s: int) -> None:
        """Gives the selected device a bit rate of CiA 305's table, not yet active and not yet stored."""

    def store(self) -> None:
        """The selected device keeps node id and bit rate beyond power-off."""
