"""A device that only sends: nothing can be asked of it. Implements station.ports.device.Device."""

from collections.abc import Collection

from station.adapters.object_access.client import NO_OBJECT
from station.adapters.object_access.without_states import WithoutStates
from station.domain.product.sdo_codes import address
from station.errors import DeviceRefused
from station.ports.device import Identity


class SendingDevice(WithoutStates):
    """It always sends its readings; it has no objects, no states and no commands."""

    def __init__(self, node: int) -> None:
        self.node = node

    def identify(self, required: Collection[tuple[int, int]] = ()) -> Identity:  # noqa: ARG002 - a product asks nothing
        """It names nothing: the label alone says which unit it is."""
        return Identity(0, 0, 0, 0, 0, "", "", "")

    def upload(self, index: int, sub: int, timeout_s: float | None = None) -> bytes:  # noqa: ARG002 - of the port
        """DeviceRefused: it has no objects."""
        raise self._refusal(index, sub)

    def download(self, index: int, sub: int, data: bytes, timeout_s: float | None = None) -> None:  # noqa: ARG002
        """DeviceRefused: it has no objects."""
        raise self._refusal(index, sub)

    def nmt(self, command: str) -> None:
        """It obeys no command."""

    def wait_boot_up(self, timeout_s: float) -> None:
        """It cannot be restarted, so there is nothing to wait for."""

    def boot_ups(self) -> int:
        """A restart shows in nothing but a gap of its frames."""
        return 0

    def _refusal(self, index: int, sub: int) -> DeviceRefused:
        return DeviceRefused("device-only-sends", node=self.node, object=address(index, sub), code=NO_OBJECT)
