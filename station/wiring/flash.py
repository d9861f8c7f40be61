"""`station flash`, put together: an image from its file, and the device of a nest."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from station.config.documents import load_document, validate
from station.domain.core.types import NestAssignment
from station.domain.product.firmware import FirmwareImage, hardware_refusal
from station.domain.product.product import decode_serial, stored_serial
from station.errors import ProductError, UsageError, WrongUnit
from station.messages import Message, system_reason
from station.ports.device import Device, Identity
from station.service.flash import Flashed, ProgramDownload
from station.service.flash_record import FlashSubject, record_flash
from station.wiring.bench import Bench, open_bench
from station.wiring.run_order import RunOrder


@dataclass(frozen=True, slots=True)
class FlashResult:
    """What came of a flash, and the version that the device then says it runs."""

    flashed: Flashed
    version: str


def load_image(path: Path) -> tuple[FirmwareImage, bytes]:
    """An image and its bytes. Errors: ProductError where the file or the image is wrong or missing."""
    image = validate(load_document(path, ProductError), FirmwareImage, ProductError)
    try:
        data = (path.parent / image.image).read_bytes()
    except OSError as exc:
        raise ProductError(
            "firmware-image-unreadable", file=str(path), image=image.image, why=system_reason(exc)
        ) from exc
    if (read := hashlib.sha256(data).hexdigest()) != image.sha256:
        raise ProductError("firmware-damaged", file=str(path), image=image.image, read=read, wanted=image.sha256)
    return image, data


def flash_unit(
    order: RunOrder, path: Path, serial: str, nest: str | None, tell: Callable[[Message], None]
) -> FlashResult:
    """Flashes the unit of that printed serial; what was tried and what came of it is sealed into the log.

    Errors: those of the image before the bus is opened; WrongUnit, WrongProduct before anything is written; those of
    the service; StoreFault.
    """
    image, data = load_image(path)
    with open_bench(order) as bench:
        if bench.job.product.map.protocol != "canopen":
            names = {"product": bench.job.product.name, "protocol": bench.job.product.map.protocol}
            raise UsageError("firmware-needs-canopen", **names)
        seat = _seat(bench, serial, nest)
        device = bench.station.device(seat.node)
        station = bench.station
        download = ProgramDownload(device, station.clock, image, data, tell)

        def flash() -> tuple[Flashed, str]:
            done = download.run(station.settings.timeouts.boot_s, lambda: _refusals(bench, device, image, seat))
            return done, device.identify(()).software

        place = (seat.serial, seat.nest, seat.node)
        subject = FlashSubject.of(place, image, station.settings.operator, simulated=bench.simulated)
        return FlashResult(*record_flash(station.store, subject, flash))


def _seat(bench: Bench, serial: str, nest: str | None) -> NestAssignment:
    nests = {n.name: n for n in bench.station.settings.nests}
    name = nest or next(iter(nests))
    if name not in nests:
        raise UsageError("unknown-nest", nest=name[:40], nests=tuple(nests))
    seat = NestAssignment(serial, name, nests[name].node)
    bench.fixture.place([seat])
    return seat


def _refusals(bench: Bench, device: Device, image: FirmwareImage, seat: NestAssignment) -> tuple[Message, ...]:
    """How the device differs from what the image is for. Errors: WrongUnit where another unit sits there."""
    identity = device.identify(image.identity.required)
    _check_serial(bench, device, seat)
    wanted = bench.job.product.model_copy(update={"identity": image.identity})
    return (*_mismatches(wanted.mismatches, identity), *_hardware(image, identity))


def _mismatches(compare: Callable[..., tuple[Message, ...]], identity: Identity) -> tuple[Message, ...]:
    return compare(
        device_type=identity.device_type,
        vendor=identity.vendor,
        product=identity.product,
        revision=identity.revision,
        name=identity.name,
    )


def _hardware(image: FirmwareImage, identity: Identity) -> tuple[Message, ...]:
    refusal = hardware_refusal(image, identity.hardware)
    return () if refusal is None else (refusal,)


def _check_serial(bench: Bench, device: Device, seat: NestAssignment) -> None:
    place = bench.job.product.map.serial_object
    if place is None:
        return
    read, wanted = decode_serial(place, device.upload(*place.address)), stored_serial(place, seat.serial)
    if read != wanted:
        label = Message("unit-in-nest", serial=seat.serial, nest=seat.nest)
        raise WrongUnit("wrong-unit", unit=label, read=read, expected=wanted)
