"""Who sits in the nest, what it holds now, and how it is made ready to be measured."""

from collections.abc import Callable, Iterator, Mapping

from station.domain.product import number_format, writeback
from station.domain.product.device_map import DeviceMap, DeviceSetting
from station.domain.product.firmware import gate_refusals
from station.domain.product.product import decode_serial, stored_serial
from station.domain.product.sdo_codes import address
from station.domain.run.unit_state import SWITCHED, UnitState
from station.errors import DeviceChanged, DeviceRefused, ReadBackDiffers, StationError, WrongProduct, WrongUnit
from station.messages import Message
from station.ports.device import Identity
from station.ports.store import Store
from station.service import process_data
from station.service.download import download
from station.service.flash import read_software_id
from station.service.station import Job
from station.service.unit import Address, RunSetting, Unit

#: NMT state found → command that brings the device back to it; where none is known it is that after power-on.
_LEAVE_AS = {"operational": "start", "stopped": "stop"}


def identify(unit: Unit, job: Job, store: Store) -> None:
    """Reads who the device is and records it. Errors: WrongProduct; WrongUnit when the label is another unit's."""
    identity, serial = _read_identity(unit, job)
    document = {name: getattr(identity, name) for name in identity.__slots__}
    source = "label" if serial is None else "device"
    store.result(unit.attempt, "identity", {**document, "kept_serial": serial, "serial_from": source})
    _check(unit, job, identity)
    _check_firmware(unit, job, identity, store)
    unit.enter(UnitState.IDENTIFIED)


def _check_firmware(unit: Unit, job: Job, identity: Identity, store: Store) -> None:
    """WrongProduct when the recipe wants other software than the unit runs."""
    gate = job.recipe.firmware
    if gate is None:
        return
    software_id = None if gate.software_id is None else read_software_id(unit.device)
    store.event(unit.attempt, "firmware", {"version": identity.software, "software_id": software_id})
    if wrong := tuple(gate_refusals(gate, identity.software, software_id)):
        raise WrongProduct("firmware-not-wanted", unit=unit.label, why=wrong)


def identify_for_recovery(unit: Unit, job: Job) -> None:
    """The same for a unit whose attempt is over: nothing is recorded but what recovery itself adds."""
    identity, _ = _read_identity(unit, job)
    _check(unit, job, identity)


def _read_identity(unit: Unit, job: Job) -> tuple[Identity, int | str | None]:
    """The identity, and the serial that the device keeps; None where the label alone says it."""
    unit.identity = unit.device.identify(job.product.identity.required)
    place = job.product.map.serial_object
    if place is None:
        return unit.identity, None
    raw = unit.device.upload(*place.address)
    unit.old = {place.address: raw}
    return unit.identity, decode_serial(place, raw)


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
    place = job.product.map.serial_object
    if place is None:
        return
    found, wanted = decode_serial(place, unit.old[place.address]), stored_serial(place, unit.seat.serial)
    if found != wanted:
        raise WrongUnit("wrong-unit", unit=unit.label, read=found, expected=wanted)


def read_old_values(unit: Unit, job: Job, store: Store) -> None:
    """Reads every object that the calibration may change, and keeps the values before anything is touched."""
    device_map = job.product.map
    old = {at: unit.device.upload(*at) for at in _changed(device_map)}
    unit.old = {**unit.old, **old}
    settings = [_setting(s, unit.device.upload(*s.address)) for s in device_map.settings]
    unit.settings = tuple(settings)
    found = {**unit.old, **{s.address: s.found for s in settings}}
    store.result(unit.attempt, "old-calibration", {"objects": objects_to_text(found)})


def make_ready(unit: Unit, job: Job, store: Store) -> None:
    """Settings for calibrating, PDOs that send, NMT operational, raw output; each switch is read back."""
    unit.boot_ups = unit.device.boot_ups()
    unit.device.emergencies()  # those of power-on are known
    if not unit.found_state:
        unit.found_state = unit.device.state()
    if job.product.map.protocol == "canopen":  # another protocol's objects of these numbers mean something else
        unit.heartbeat_s = _heartbeat_s(unit)
        process_data.read(unit, job, store)
    unit.enter(UnitState.PREPARED)
    set_for_run(unit, job, raw=True)


def set_for_run(unit: Unit, job: Job, *, raw: bool) -> None:
    """Brings settings and output to what the readings need: for the tumble raw, for the verification compensated."""
    unit.switched = True
    for setting in unit.settings:
        if setting.wanted is None or not (raw or setting.lasts):
            continue
        try:
            set_checked(unit, setting.address, setting.wanted, setting.name)
        except DeviceRefused:
            if not setting.may_refuse:
                raise
            process_data.refused(unit, setting)
    unit.device.nmt("start")
    switch = writeback.output(job.product.map, raw=raw)
    if switch is None:
        return
    # After the reset the switch may be raw again: a product may keep it in working memory only.
    if raw or unit.device.upload(*switch.address) != switch.raw:
        set_checked(unit, switch.address, switch.raw, switch.name)


def _heartbeat_s(unit: Unit) -> float:
    """Producer heartbeat time (0x1017), s; 0 where the device has none."""
    try:
        return int.from_bytes(unit.device.upload(0x1017, 0), "little") / 1000
    except DeviceRefused:
        return 0.0


def check_still_set(unit: Unit, job: Job, *, raw: bool) -> None:
    """DeviceChanged when output or settings are no longer as `set_for_run` left them: what was read meanwhile may be of
    either kind. A device that restarts without a word brings its output back as it is stored."""
    expected = {
        s.address: (s.wanted if raw or s.lasts else s.found, s.name)
        for s in unit.settings
        if s.wanted is not None and not s.may_refuse
    }
    if (switch := writeback.output(job.product.map, raw=raw)) is not None:
        expected[switch.address] = switch.raw, switch.name
    for at, (wanted, name) in expected.items():
        if (read := unit.device.upload(*at)) != wanted:
            shown = {"name": name, "object": address(*at), "read": read.hex(), "expected": wanted.hex()}
            raise DeviceChanged("setting-changed", unit=unit.label, **shown)


def set_compensated(unit: Unit, job: Job) -> None:
    """Compensated output, and the settings as the device came with them."""
    _settings_as_found(unit)
    switch = writeback.output(job.product.map, raw=False)
    if switch is not None:
        set_checked(unit, switch.address, switch.raw, switch.name)


def _settings_as_found(unit: Unit) -> None:
    for setting in reversed(unit.settings):
        if setting.wanted is None:
            continue
        if not setting.may_refuse or unit.device.upload(*setting.address) != setting.found:
            set_checked(unit, setting.address, setting.found, setting.name)


def restore_as_found(unit: Unit, job: Job) -> Message | None:
    """Puts output, settings and NMT state back as they were found, as far as the device still answers; None or what
    failed."""
    failed = _failure(lambda: _switches_as_found(unit, job)) if unit.switched else None
    if not unit.found_state:
        return failed
    # Whatever became of the rest: a command that nobody answers costs nothing.
    left = _LEAVE_AS.get(unit.found_state, "pre-operational")
    unanswered = _failure(lambda: unit.device.nmt(left))
    return failed or unanswered


def _failure(act: Callable[[], None]) -> Message | None:
    try:
        act()
    except StationError as exc:
        return exc.message
    return None


def _switches_as_found(unit: Unit, job: Job) -> None:
    _settings_as_found(unit)
    output = job.product.map.switch
    if output is not None and output.address in unit.old and unit.state in SWITCHED:
        set_checked(unit, output.address, unit.old[output.address], "output switch")


def set_checked(unit: Unit, at: Address, raw: bytes, name: str) -> None:
    """Writes one object and reads it back; a device that had to be set pre-operational for it is started again. Errors:
    those of SDO; ReadBackDiffers."""
    was_stopped = download(unit, at, raw)
    if (read := unit.device.upload(*at)) != raw:
        raise ReadBackDiffers("setting-differs", unit=unit.label, name=name, read=read.hex(), written=raw.hex())
    if was_stopped:
        unit.device.nmt("start")


def _changed(device_map: DeviceMap) -> Iterator[Address]:
    """Addresses that a calibration changes, in the order of the map."""
    for _, number in device_map.coefficients():
        yield number.address
    for part in (device_map.valid, device_map.temperature, device_map.record, device_map.switch):
        if part is not None:
            yield part.address
    if device_map.configuration is not None:
        yield from ((device_map.configuration.index, sub) for sub in (1, 2))


def _setting(setting: DeviceSetting, found: bytes) -> RunSetting:
    wanted = None
    if setting.calibrating is not None:
        encoder = number_format.parse(setting.type)
        wanted = encoder.encode(setting.sign * setting.calibrating / setting.scale)
    return RunSetting(setting.address, setting.name, found, wanted, setting.lasts)


def objects_to_text(raws: Mapping[Address, bytes]) -> dict[str, str]:
    """Objects as the log writes them: `2101:01` → bytes in hexadecimal."""
    return {f"{index:04X}:{sub:02X}": raw.hex() for (index, sub), raw in raws.items()}


def objects_from_text(objects: Mapping[str, str]) -> dict[Address, bytes]:
    """What `objects_to_text` wrote."""
    return {(int(key[:4], 16), int(key[5:], 16)): bytes.fromhex(raw) for key, raw in objects.items()}
