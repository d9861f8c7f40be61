"""What `station doctor` looks at; each check is a function that returns what it found, or raises what is wrong."""

import os
import shutil
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from station.cli import _output
from station.config.settings import Settings, load_settings
from station.domain.product.map_check import mismatches
from station.domain.records.stored_attempt import is_simulated
from station.errors import BusFault, ConfigError, ReferenceOverdue, StationError, StationFault, StoreFault, UsageError
from station.files.real_path import real_path
from station.messages import Message, render
from station.ports.log_reader import Query
from station.service import golden_register
from station.wiring.buses import bus_kind
from station.wiring.jobs import load_job
from station.wiring.logs import find_log, open_log, public_key_of_signer
from station.wiring.product_files import read_dictionary

#: A transmit queue shorter than this fills up in bursts; how long the bus is listened to, s.
SHORT_QUEUE, LISTEN_S = 100, 1.0
#: A simulated run takes less time than its clock says: its records may be so far ahead.
SIMULATED_AHEAD_S = 3600.0
#: Checks that a simulated station has no use for.
BUS_CHECKS = ("bus", "traffic")
#: Less free space than this is soon none, bytes.
LOW_DISK_BYTES = 2 * 1024**3


@dataclass(frozen=True, slots=True)
class DoctorRequest:
    """What the command line asks for."""

    recipe: str | None
    config: Path | None
    db: Path | None
    simulate: bool


@dataclass(frozen=True, slots=True)
class DoctorContext:
    """What the checks look at."""

    settings: Settings
    database: Path
    recipe: str


def run_checks(request: DoctorRequest, *, as_json: bool) -> int:
    """Every check, one line each; 0 when all are well, 3 otherwise. Errors: ConfigError."""
    settings = load_settings(request.config)
    station = DoctorContext(settings, request.db or Path(settings.database), request.recipe or settings.recipe)
    checks = {k: v for k, v in CHECKS.items() if not (k in BUS_CHECKS and _simulated(request, settings))}
    results = [_run_check(name, check, station) for name, check in checks.items()]
    well = all(r["well"] for r in results)
    if as_json:
        _output.print_json({"schema": "station.doctor/1", "well": well, "checks": results})
    else:
        for r in results:
            _output.print_line(f"{'✔' if r['well'] else '✘'} {r['check']}: {r['said']}")
    return 0 if well else StationFault.exit_code


def _simulated(request: DoctorRequest, settings: Settings) -> bool:
    return request.simulate or not bus_kind(settings.bus).interface_of_kernel


def _run_check(name: str, check: Callable[[DoctorContext], Message], station: DoctorContext) -> dict[str, Any]:
    try:
        message, well = check(station), True
    except StationError as exc:
        message, well = exc.message, False
    return {"check": name, "well": well, "said": render(message), "message": message.document()}


def _bus(station: DoctorContext) -> Message:
    bus = station.settings.bus
    from station.wiring.bus_status import bitrate_of, query_link

    bitrate = bitrate_of(bus)

    setup = f"ip link set {bus.channel} type can bitrate {bitrate} && ip link set {bus.channel} up"
    try:
        link = query_link(bus.channel)
    except OSError:
        interfaces = [n for _, n in socket.if_nameindex() if "can" in n]
        raise BusFault("can-no-interface", channel=bus.channel, interfaces=interfaces, setup=setup) from None
    if not link.up:
        raise BusFault("can-down", channel=bus.channel, setup=setup)
    if link.bitrate not in (None, bitrate):
        raise BusFault("can-other-bitrate", channel=bus.channel, bitrate=link.bitrate, expected=bitrate, setup=setup)
    errors = Message("can-error-counters-unknown")
    if link.counters:
        errors = Message("can-error-counters", sending=link.counters.sending, receiving=link.counters.receiving)
    if link.can_state not in (None, "active"):
        raise BusFault("can-error-state", channel=bus.channel, state=str(link.can_state), errors=errors, setup=setup)
    up = Message(
        "doctor-bus-up", channel=bus.channel, kind=str(link.kind), state=link.can_state or "unknown", errors=errors
    )
    if link.queue is not None and link.queue < SHORT_QUEUE:
        return Message("doctor-bus-short-queue", up=up, channel=bus.channel, frames=link.queue)
    return up


def _traffic(station: DoctorContext) -> Message:
    """Listens for a moment and sends nothing: another station may be at work. Error frames mean a fault."""
    from station.domain.can.error_frames import error_frames
    from station.domain.core.types import ERROR, Frames
    from station.wiring.bus_status import open_listener

    name = station.settings.bus.channel
    bus = open_listener(name)
    try:
        channel, until_s = bus.stream(()), time.monotonic() + LISTEN_S
        parts = [channel.receive(0.0)]
        while (remaining_s := until_s - time.monotonic()) > 0:
            parts.append(channel.receive(remaining_s))
    finally:
        bus.close()
    frames = Frames.join(parts)
    if errors := error_frames(frames):
        raise BusFault("bus-reports-errors", bus=name, errors=errors)
    plain = frames.can_id[(frames.can_id & ERROR) == 0]
    if not len(plain):
        return Message("doctor-bus-silent", channel=name, duration_s=LISTEN_S)
    nodes = {int(i) & 0x7F for i in plain.tolist()} & {n.node for n in station.settings.nests}
    names = [n.name for n in station.settings.nests if n.node in nodes]
    rate = len(plain) / LISTEN_S
    if not names:
        return Message("doctor-bus-no-nest", channel=name, rate=rate)
    return Message("doctor-bus-traffic", channel=name, rate=rate, nests=names)


def _rights(station: DoctorContext) -> Message:
    folder = real_path(station.database).parent
    if not folder.is_dir():
        raise StoreFault("doctor-no-folder", folder=str(folder))
    paths = [folder, *(p for p in (station.database,) if p.exists())]
    for path in paths:
        if not os.access(path, os.R_OK | os.W_OK):
            raise StoreFault("doctor-not-writable", user=os.getuid(), path=str(path))
    return Message("doctor-writable", folder=str(folder))


def _clock(station: DoctorContext) -> Message:
    now_s = time.time()
    if now_s < 1.7e9:
        raise StationFault("doctor-clock-unset")
    if station.database.exists():
        with open_log(station.database) as log:
            newest = log.attempts(Query(), 1)
        ahead_s = newest[0].started_ns / 1e9 - now_s if newest else 0.0
        if ahead_s > (SIMULATED_AHEAD_S if newest and is_simulated(newest[0].software) else 1.0):
            raise StationFault("doctor-clock-behind", behind_s=ahead_s)
    synchronised = Path("/run/systemd/timesync/synchronized").exists()
    return Message("doctor-clock-synchronised" if synchronised else "doctor-clock-well")


def _disk(station: DoctorContext) -> Message:
    folder = real_path(station.database).parent
    if not folder.is_dir():
        raise StoreFault("doctor-no-folder", folder=str(folder))
    free = shutil.disk_usage(folder).free
    if free < LOW_DISK_BYTES:
        raise StoreFault(
            "doctor-disk-low", folder=str(folder), free_gib=free / 1024**3, limit_gib=LOW_DISK_BYTES / 1024**3
        )
    return Message("doctor-disk-free", folder=str(folder), free_gib=free / 1024**3)


def _recipe(station: DoctorContext) -> Message:
    _, source = load_job(station.recipe)
    return Message("doctor-recipe", recipe=str(source.recipe), product=str(source.product), dbc=str(source.dbc))


def _map(station: DoctorContext) -> Message:
    job, source = load_job(station.recipe)
    if source.eds is None:
        return Message("doctor-no-eds", product=str(source.product))
    wrong = mismatches(job.product.map, read_dictionary(source.eds, station.settings.nests[0].node))
    if wrong:
        raise ConfigError("map-contradicts-eds", file=str(source.product), eds=str(source.eds), mismatches=wrong)
    return Message("doctor-map-fits", product=str(source.product), eds=str(source.eds))


def _key(station: DoctorContext) -> Message:
    path = station.settings.signing_key
    if not path:
        return Message("doctor-no-key")
    mode = Path(path).stat().st_mode & 0o077 if Path(path).exists() else 0
    if mode:
        raise ConfigError("doctor-key-readable", path=path)
    return Message("doctor-key", path=path, public=public_key_of_signer(Path(path)).hex()[:16])


def _golden(station: DoctorContext) -> Message:
    if station.settings.golden is None:
        return Message("doctor-golden-off")
    statuses = golden_register.standings(station.settings, partial(find_log, station.database))
    if not statuses:
        raise UsageError("golden-register-empty", file=station.settings.golden.file)
    problems = [s.problem for s in statuses if s.problem]
    if problems:
        raise ReferenceOverdue("; ".join(problems))
    return Message("doctor-golden-well", count=len(statuses))


CHECKS: dict[str, Callable[[DoctorContext], Message]] = {
    "bus": _bus,
    "traffic": _traffic,
    "rights": _rights,
    "clock": _clock,
    "disk": _disk,
    "recipe and DBC": _recipe,
    "device map": _map,
    "key": _key,
    "golden units": _golden,
}
