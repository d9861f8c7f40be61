"""Who sits in the nest, what it holds now, and how it is made ready to be measured."""

from collections.abc import Iterator, Mapping

from station.domain.product import number_format, writeback
from station.domain.product.device_map import DeviceMap, DeviceSetting
from station.domain.product.product import decode_serial, stored_serial
from station.domain.run.unit_state import SWITCHED, UnitState
from station.errors import DeviceRefused, ReadBackDiffers, StationError, WrongProduct, WrongUnit
from station.messages import Message
from station.ports.device import Identity
from station.ports.store import Store
from station.service.station import Job
from station.service.unit import Address, Unit


def identify(unit: Unit, job: Job, store: Store) -> None:
    """Reads who the device is and records it. Errors: WrongProduct; WrongUnit when the label is another unit's."""
    identity = unit.device.identify()
    place = job.product.map.serial
    raw = unit.device.upload(*place.address)
    unit.identity, unit.old = identity, {place.address: raw}
    document = {name: getattr(identity, name) for name in identity.__slots__}
    store.result(unit.attempt, "identity", {**document, "kept_serial": decode_serial(place, raw)})
    _check(unit, job, identity)
    unit.enter(UnitState.IDENTIFIED)


def identify_for_recovery(unit: Unit, job: Job) -> None:
    """The same for a unit whose attempt is over: nothing is recorded but what recovery itself adds."""
    identity = unit.device.identify()
    place = job.product.map.serial
    unit.identity, unit.old = identity, {place.address: unit.device.upload(*place.address)}
    _check(unit, job, identity)


def _check(unit: Unit, job: Job, identity: Identity) -> None:
    wrong = job.product.mismatches(
        device_type=identity.device_type,
        vendor=identity.vendor,
        product=identity.product,
        revision=identity.revision,
        name=identity.name,
    )
    if wrong:
        raise WrongProduct("wrong-product", unit=unit.label, product=job.product.name, mismatches=wrong)
    place = job.product.map.serial
    found, wanted = decode_serial(place, unit.old[place.address]), stored_serial(place, unit.seat.serial)
    if found != wanted:
        raise WrongUnit("wrong-unit", unit=unit.label, read=found, expected=wanted)


def read_old_values(unit: Unit, job: Job, store: Store) -> None:
    """Reads every object that the calibration may change, and keeps the values before anything is touched."""
    device_map = job.product.map
    old = {at: unit.device.upload(*at) for at in _changed(device_map)}
    unit.old = {**unit.old, **old}
    unit.settings_old = {s.address: unit.device.upload(*s.address) for s in device_map.settings}
    store.result(unit.attempt, "old-calibration", {"objects": objects_to_text({**unit.old, **unit.settings_old})})


def make_ready(unit: Unit, job: Job) -> None:
    """Settings for calibrating, NMT operational, raw output; each switch is read back."""
    unit.boot_ups = unit.device.boot_ups()
    unit.heartbeat_s = _heartbeat_s(unit)
    unit.device.emergencies()  # those of power-on are known
    unit.enter(UnitState.PREPARED)
    for setting in job.product.map.settings:
        if setting.calibrating is not None:
            set_checked(unit, setting.address, _raw(setting, setting.calibrating), setting.name)
    unit.device.nmt("start")
    switch = writeback.output(job.product.map, raw=True)
    if switch is not None:
        set_checked(unit, switch.address, switch.raw, switch.name)


def _heartbeat_s(unit: Unit) -> float:
    """Producer heartbeat time (0x1017), s; 0 where the device has none."""
    try:
        return int.from_bytes(unit.device.upload(0x1017, 0), "little") / 1000
    except DeviceRefused:
        return 0.0


def set_compensated(unit: Unit, job: Job) -> None:
    """Compensated output, and the settings as the device came with them."""
    for at, raw in unit.settings_old.items():
        set_checked(unit, at, raw, "setting")
    switch = writeback.output(job.product.map, raw=False)
    if switch is not None:
        set_checked(unit, switch.address, switch.raw, switch.name)


def restore_as_found(unit: Unit, job: Job) -> Message | None:
    """Puts output and settings back as they were found, as far as the device still answers; None or what failed."""
    try:
        if unit.state in SWITCHED:
            for at, raw in unit.settings_old.items():
                set_checked(unit, at, raw, "setting")
            output = job.product.map.output
            if output is not None and output.address in unit.old:
                set_checked(unit, output.address, unit.old[output.address], "output switch")
        unit.device.nmt("pre-operational")
    except StationError as exc:
        return exc.message
    return None


def set_checked(unit: Unit, at: Address, raw: bytes, name: str) -> None:
    """Writes one object and reads it back. Errors: ReadBackDiffers."""
    unit.device.download(*at, raw)
    if (read := unit.device.upload(*at)) != raw:
        raise ReadBackDiffers("setting-differs", unit=unit.label, name=name, read=read.hex(), written=raw.hex())


def _changed(device_map: DeviceMap) -> Iterator[Address]:
    """Addresses that a calibration changes, in the order of the map."""
    for _, number in device_map.coefficients():
        yield number.address
    for part in (device_map.valid, device_map.temperature, device_map.record, device_map.output):
        if part is not None:
            yield part.address
    if device_map.configuration is not None:
        yield from ((device_map.configuration.index, sub) for sub in (1, 2))


def _raw(setting: DeviceSetting, value: float) -> bytes:
    return number_format.parse(setting.type).encode(setting.sign * value / setting.scale)


def objects_to_text(raws: Mapping[Address, bytes]) -> dict[str, str]:
    """Objects as the log writes them: `2101:01` → bytes in hexadecimal."""
    return {f"{index:04X}:{sub:02X}": raw.hex() for (index, sub), raw in raws.items()}


def objects_from_text(objects: Mapping[str, str]) -> dict[Address, bytes]:
    """What `objects_to_text` wrote."""
    return {(int(key[:4], 16), int(key[5:], 16)): bytes.fromhex(raw) for key, raw in objects.items()}
