"""What `station doctor` looks at; each check is a function that says what it found, or raises what is wrong."""

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
from station.errors import BusFault, ConfigError, ReferenceOverdue, StationError, StationFault, StoreFault, UsageError
from station.ports.log_reader import Query
from station.service import golden_register
from station.wiring.buses import bus_kind
from station.wiring.jobs import load_job
from station.wiring.logs import find_log, open_log, public_key_of_signer
from station.wiring.product_files import read_dictionary

#: A transmit queue shorter than this fills up in bursts; how long the bus is listened to, s.
SHORT_QUEUE, LISTEN_S = 100, 1.0
#: Checks that a simulated station has no use for.
BUS_CHECKS = ("bus", "traffic")
#: Less free space than this is soon none, bytes.
LOW_DISK_BYTES = 2 * 1024**3


@dataclass(frozen=True, slots=True)
class DoctorRequest:
    """What the command line says."""

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


def run_checks(asked: DoctorRequest, *, as_json: bool) -> int:
    """Every check, each told in a line; 0 when all are well, 3 otherwise. Errors: ConfigError."""
    settings = load_settings(asked.config)
    station = DoctorContext(settings, asked.db or Path(settings.database), asked.recipe or settings.recipe)
    checks = {k: v for k, v in CHECKS.items() if not (k in BUS_CHECKS and _simulated(asked, settings))}
    found = [_run_check(name, check, station) for name, check in checks.items()]
    well = all(f["well"] for f in found)
    if as_json:
        _output.print_json({"schema": "station.doctor/1", "well": well, "checks": found})
    else:
        for f in found:
            _output.print_line(f"{'✔' if f['well'] else '✘'} {f['check']}: {f['said']}")
    return 0 if well else StationFault.exit_code


def _simulated(asked: DoctorRequest, settings: Settings) -> bool:
    return asked.simulate or not bus_kind(settings.bus).interface_of_kernel


def _run_check(name: str, check: Callable[[DoctorContext], str], station: DoctorContext) -> dict[str, Any]:
    try:
        return {"check": name, "well": True, "said": check(station)}
    except StationError as exc:
        return {"check": name, "well": False, "said": exc.sentence}


def _bus(station: DoctorContext) -> str:
    bus = station.settings.bus
    from station.wiring.bus_status import bitrate_of, query_link

    bitrate = bitrate_of(bus)

    setup = f"ip link set {bus.channel} type can bitrate {bitrate} && ip link set {bus.channel} up"
    try:
        link = query_link(bus.channel)
    except OSError:
        known = ", ".join(n for _, n in socket.if_nameindex() if "can" in n) or "none"
        raise BusFault(
            f"there is no interface {bus.channel} (CAN interfaces here: {known}); plug the adapter in, then `{setup}`"
        ) from None
    if not link.up:
        raise BusFault(f"{bus.channel} is down; as root: `{setup}`")
    if link.bitrate not in (None, bitrate):
        raise BusFault(f"{bus.channel} runs at {link.bitrate} bit/s, but config.yaml says {bitrate}; `{setup}`")
    errors = f", errors sending {link.counters.sending}, receiving {link.counters.receiving}" if link.counters else ""
    if link.can_state not in (None, "active"):
        remedy = f"check wiring, termination and bit rate, then `{setup}`"
        raise BusFault(f"{bus.channel} is {link.can_state}{errors}; {remedy}")
    short = link.queue is not None and link.queue < SHORT_QUEUE
    queue = f"; its queue holds {link.queue} frames, `ip link set {bus.channel} txqueuelen 1000`" if short else ""
    return f"{bus.channel} ({link.kind}) is up, state {link.can_state or 'not told'}{errors}{queue}"


def _traffic(station: DoctorContext) -> str:
    """Listens for a moment and sends nothing: another station may be at work. Error frames are somebody's trouble."""
    from station.domain.can.error_frames import error_frames
    from station.domain.core.types import ERROR, Frames
    from station.wiring.bus_status import open_listener

    name = station.settings.bus.channel
    bus = open_listener(name)
    try:
        channel, until_s = bus.stream(()), time.monotonic() + LISTEN_S
        parts = [channel.receive(0.0)]
        while (left_s := until_s - time.monotonic()) > 0:
            parts.append(channel.receive(left_s))
    finally:
        bus.close()
    frames = Frames.join(parts)
    if told := error_frames(frames):
        raise BusFault("bus-reports-errors", bus=name, errors=told)
    plain = frames.can_id[(frames.can_id & ERROR) == 0]
    if not len(plain):
        return f"nothing came on {name} in {LISTEN_S:g} s; are the units powered?"
    nodes = {int(i) & 0x7F for i in plain.tolist()} & {n.node for n in station.settings.nests}
    names = [n.name for n in station.settings.nests if n.node in nodes]
    heard = f"frames of nests {', '.join(names)}" if names else "none of them from a nest; are the units powered?"
    return f"{len(plain) / LISTEN_S:.0f} frames/s on {name}, {heard}"


def _rights(station: DoctorContext) -> str:
    folder = station.database.resolve().parent
    if not folder.is_dir():
        raise StoreFault(f"there is no folder {folder} for the log; make it, or change `database`")
    paths = [folder, *(p for p in (station.database,) if p.exists())]
    for path in paths:
        if not os.access(path, os.R_OK | os.W_OK):
            raise StoreFault(f"user {os.getuid()} may not write {path}; `chown {os.getuid()} {path}` gives it to them")
    return f"{folder} can be written"


def _clock(station: DoctorContext) -> str:
    now_s = time.time()
    if now_s < 1.7e9:
        raise StationFault("the clock stands before 2024; set it, or let NTP set it: `timedatectl set-ntp true`")
    if station.database.exists():
        with open_log(station.database) as log:
            newest = log.attempts(Query(), 1)
        ahead_s = newest[0].started_ns / 1e9 - now_s if newest else 0.0
        if ahead_s > 1:
            raise StationFault(f"the clock is {ahead_s:.0f} s behind the newest record of the log; set it by NTP")
    synchronised = Path("/run/systemd/timesync/synchronized").exists()
    return f"not before the newest record; {'NTP has set it' if synchronised else 'whether NTP sets it is not known'}"


def _disk(station: DoctorContext) -> str:
    folder = station.database.resolve().parent
    if not folder.is_dir():
        raise StoreFault(f"there is no folder {folder} for the log; make it, or change `database`")
    free = shutil.disk_usage(folder).free
    if free < LOW_DISK_BYTES:
        raise StoreFault(f"{folder} has {free / 1024**3:.1f} GiB left; free some, a full disk stops the line")
    return f"{free / 1024**3:.0f} GiB free at {folder}"


def _recipe(station: DoctorContext) -> str:
    _, source = load_job(station.recipe)
    return f"{source.recipe}, product {source.product}, frames {source.dbc}"


def _map(station: DoctorContext) -> str:
    job, source = load_job(station.recipe)
    if source.eds is None:
        return f"{source.product} names no EDS to hold the map against"
    wrong = mismatches(job.product.map, read_dictionary(source.eds, station.settings.nests[0].node))
    if wrong:
        raise ConfigError("map-contradicts-eds", file=str(source.product), eds=str(source.eds), mismatches=wrong)
    return f"{source.product} fits {source.eds}"


def _key(station: DoctorContext) -> str:
    path = station.settings.signing_key
    if not path:
        return "none; the chain shows edits, but a `signing_key` would also show a rebuilt log"
    mode = Path(path).stat().st_mode & 0o077 if Path(path).exists() else 0
    if mode:
        raise ConfigError(f"others may read the station key {path}; `chmod 600 {path}`")
    return f"{path}, public half {public_key_of_signer(Path(path)).hex()[:16]}…"


def _golden(station: DoctorContext) -> str:
    if station.settings.golden is None:
        return "not wanted by config.yaml"
    found = golden_register.standings(station.settings, partial(find_log, station.database))
    if not found:
        raise UsageError(f"{station.settings.golden.file} registers none; run one and `station golden register SERIAL`")
    problems = [s.problem for s in found if s.problem]
    if problems:
        raise ReferenceOverdue("; ".join(problems))
    return f"{len(found)} units as registered"


CHECKS: dict[str, Callable[[DoctorContext], str]] = {
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
