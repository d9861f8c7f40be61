"""One object written, in whatever NMT state the device takes it."""

from station.domain.product.sdo_codes import DEVICE_STATE
from station.errors import DeviceRefused
from station.service.unit import Address, Unit


def download(unit: Unit, at: Address, raw: bytes, timeout_s: float | None = None) -> bool:
    """Writes one object. A device that takes it only while it sends nothing is set pre-operational and asked once more:
    it has refused, so nothing is done twice. Returns whether that was so; it is pre-operational then. Errors: those of
    SDO."""
    try:
        unit.device.download(*at, raw, timeout_s)
    except DeviceRefused as refused:
        if refused.code != DEVICE_STATE:
            raise
        unit.device.nmt("pre-operational")
        unit.device.download(*at, raw, timeout_s)
        return True
    return False
