"""A flash in the log: sealed before its first frame, and again with what came of it, refusals and failures too."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from station.domain.product.firmware import FirmwareImage
from station.errors import StationError, WrongProduct, WrongUnit
from station.ports.log_reader import LogReader
from station.ports.store import Store
from station.service.flash import Flashed

FLASH_EVENT = "flash"
#: More flashes than any log holds.
_ALL = 1 << 40


@dataclass(frozen=True, slots=True)
class FlashSubject:
    """What is flashed, with what: the unit as its label names it, where it sits, and the image."""

    serial: str
    nest: str
    node: int
    operator: str
    simulated: bool
    image: str
    image_sha256: str

    @staticmethod
    def of(seat: tuple[str, str, int], image: FirmwareImage, operator: str, *, simulated: bool) -> "FlashSubject":
        """seat: serial, nest, node."""
        return FlashSubject(*seat, operator, simulated, image.image, image.sha256)


def record_flash(store: Store, subject: FlashSubject, flash: Callable[[], tuple[Flashed, str]]) -> tuple[Flashed, str]:
    """Flashes, with a record before and one after it; how it ended, and the version that the device then names.

    Errors: those of the flash, once they stand in the log; StoreFault.
    """
    own = asdict(subject)
    store.event("", FLASH_EVENT, own | {"how": "intended"})
    try:
        flashed, version = flash()
    except StationError as fault:
        how = "refused" if isinstance(fault, WrongProduct | WrongUnit) else "failed"
        store.event("", FLASH_EVENT, own | {"how": how, "message": fault.message.document(), "reason": fault.sentence})
        raise
    store.event("", FLASH_EVENT, own | asdict(flashed) | {"version": version})
    return flashed, version


def flashes_of(log: LogReader, serial: str) -> list[Mapping[str, Any]]:
    """Every flash of a unit, oldest first: record, at_ns, and what was sealed."""
    rows = [(e, json.loads(e.detail)) for e in log.station_events(FLASH_EVENT, _ALL)]
    return [{"record": e.number, "at_ns": e.at_ns, **detail} for e, detail in rows if detail.get("serial") == serial]
