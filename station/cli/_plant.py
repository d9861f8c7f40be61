"""The face of the plant: settings in, then a server until it is stopped; and what a person decides about it."""

import json
import re
import ssl
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from station.cli import _output
from station.cli._witness import listening
from station.config.plant import PlantSettings, load_plant
from station.errors import ConfigError, UsageError
from station.files.system_errors import os_error_reason
from station.messages import Message, render
from station.ports.plant import QuarantineEntry
from station.web.plant import Entrances, PlantFace, connection_options, create_plant_app
from station.wiring.plant import Plant, check_public_key, new_token, open_plant

SCHEMA = "station.plant-status/1"


def serve(config: Path, host: str, port: int) -> int:
    """Serves until SIGINT or SIGTERM. Errors: ConfigError, UsageError, StoreFault, StationFault."""
    import uvicorn

    settings = load_plant(config)
    # Ctrl-C is the way to stop it, and no failure.
    with open_plant(settings) as plant, listening(host, port) as listener, suppress(KeyboardInterrupt):
        scheme = "https" if settings.tls else "http"
        at = f"{scheme}://{host}:{listener.getsockname()[1]}"
        _output.print_message(Message("plant-serving", url=at, stations=len(settings.stations)))
        options = uvicorn.Config(
            create_plant_app(_face(plant, settings)),
            log_level="warning",
            access_log=False,
            ws="none",
            **connection_options(),
            **_tls(settings),
        )
        uvicorn.Server(options).run([listener])
    return 0


def _tls(settings: PlantSettings) -> dict[str, Any]:
    if settings.tls is None:
        return {}
    for file in (settings.tls.certificate, settings.tls.key, settings.tls.authority):
        try:
            if file:
                Path(file).read_bytes()
        except OSError as error:
            raise ConfigError("plant-tls-file", file=file, reason=os_error_reason(error)) from error
    known = {"ssl_certfile": settings.tls.certificate, "ssl_keyfile": settings.tls.key}
    if not settings.tls.authority:
        return known
    demanded = all(s.certificate and not s.token_sha256 for s in settings.stations)
    reqs = ssl.CERT_REQUIRED if demanded else ssl.CERT_OPTIONAL
    return known | {"ssl_ca_certs": settings.tls.authority, "ssl_cert_reqs": reqs}


def _face(plant: Plant, settings: PlantSettings) -> PlantFace:
    tokens = {token: station for station, token, _ in plant.stations if token}
    certificates = {name: station for station, _, name in plant.stations if name}
    entrances = Entrances(tokens, certificates)
    return PlantFace(plant.receiver, plant.store, entrances, plant.clock, plant.witness, settings.most_portion_bytes)


def status(config: Path, *, as_json: bool) -> int:
    """Every station's log, and what waits for a decision; exit code 1 where something does."""
    with open_plant(load_plant(config)) as plant:
        standings, apart = plant.store.standings(), plant.store.quarantined()
    if as_json:
        _output.print_json(
            {
                "schema": SCHEMA,
                "stations": [{name: getattr(s, name) for name in s.__slots__} for s in standings],
                "quarantine": [_entry(e) for e in apart],
            }
        )
        return 1 if apart else 0
    for s in standings:
        last = f"{_local(s.last_ns):%Y-%m-%d %H:%M:%S}"
        behind = max(s.newest - s.number, 0)
        _output.print_message(
            Message("plant-station", station=s.station, number=s.number, behind=behind, last=last, log_id=s.log_id)
        )
    for e in apart:
        since = f"{_local(e.first_ns):%Y-%m-%d %H:%M:%S}"
        _output.print_message(
            Message("plant-apart", since=since, times=e.times, log_id=e.log_id, reason=e.refusal.message)
        )
    return 1 if apart else 0


def _entry(e: QuarantineEntry) -> dict[str, Any]:
    return {
        "id": e.id,
        "station": e.station,
        "log_id": e.log_id,
        "number": e.refusal.number,
        "reason": e.refusal.reason,
        "sentence": render(e.refusal.message),
        "message": e.refusal.message.document(),
        "first_ns": e.first_ns,
        "last_ns": e.last_ns,
        "times": e.times,
    }


def register(config: Path, name: str, key: Path | None) -> int:
    """Writes a new station into plant.yaml and says its token once."""
    if key is None:
        raise UsageError("plant-register-form", name=name)
    settings = load_plant(config)
    check_public_key(key)
    if name in [s.name for s in settings.stations]:
        raise UsageError("plant-registered-already", name=name, config=str(config))
    token, digest = new_token()
    entry = f"  - {{name: {_quoted(name)}, public_key: {_quoted(str(key))}, token_sha256: {digest}}}\n"
    text = config.read_text(encoding="utf-8").rstrip("\n") + "\n"
    lines = text.splitlines(keepends=True)
    at = next((i for i, line in enumerate(lines) if line.startswith("stations:")), None)
    if at is None:
        text += "stations:\n" + entry
    elif lines[at].split("#")[0].strip() == "stations:":
        text = "".join([*lines[: at + 1], entry, *lines[at + 1 :]])
    else:
        raise UsageError("plant-stations-inline", config=str(config), entry=entry.strip())
    _check_and_write(config, text)
    _output.print_message(Message("plant-registered", name=name, config=str(config)))
    _output.print_raw(token)
    return 0


def _quoted(text: str) -> str:
    """Text as YAML takes it within braces."""
    return text if re.fullmatch(r"[A-Za-z/][\w./-]*", text, re.ASCII) else json.dumps(text, ensure_ascii=False)


def _check_and_write(config: Path, text: str) -> None:
    from station.files.replace import replacing

    try:
        with replacing(config, durable=True) as part:
            part.write_text(text, encoding="utf-8")
            load_plant(part)
    except OSError as error:
        raise ConfigError("plant-config-unwritten", config=str(config), reason=os_error_reason(error)) from error


def adopt(config: Path, name: str, log_id: str, by: str, reason: str) -> int:
    """Takes a log that was set apart as the station's from here on."""
    with _deciding(config, "adopt", name, log_id, by, reason) as (plant, of_log):
        kind = plant.store.adopt(name, of_log, by, reason, plant.clock.epoch_ns())
    _output.print_message(Message("plant-adopted", station=name, log_id=of_log, kind=kind))
    return 0


def reject(config: Path, name: str, log_id: str, by: str, reason: str) -> int:
    """Decides that what was set apart of a log stays out."""
    with _deciding(config, "reject", name, log_id, by, reason) as (plant, of_log):
        count = plant.store.reject(name, of_log, by, reason, plant.clock.epoch_ns())
    _output.print_message(Message("plant-rejected", station=name, log_id=of_log, count=count))
    return 0


@contextmanager
def _deciding(config: Path, action: str, name: str, log_id: str, by: str, reason: str) -> Iterator[tuple[Plant, str]]:
    """The plant, and the log that is meant: the only one that waits where none is named. Errors: UsageError."""
    if not by or not reason:
        raise UsageError("plant-decision-form", action=action, station=name)
    with open_plant(load_plant(config)) as plant:
        logs = sorted({e.log_id for e in plant.store.quarantined() if e.station == name})
        if not log_id and len(logs) > 1:
            raise UsageError("plant-which-log", station=name, logs=logs)
        yield plant, log_id or (logs[0] if logs else "")


def grant(config: Path, name: str, stations: list[str], products: list[str]) -> int:
    """Lets a database role see stations and products; made where there is none."""
    from station.wiring.plant import grant_reader

    grant_reader(load_plant(config), name, stations, products)
    _output.print_message(Message("plant-granted", name=name, stations=stations or ["*"], products=products or ["*"]))
    return 0


def verify(config: Path, *, as_json: bool) -> int:
    """Walks every chain that the plant has; exit code 1 where something is wrong."""
    from station.wiring.plant import plant_findings

    with _output.activity(Message("activity-checking", file=str(config))):
        found = list(plant_findings(load_plant(config)))
    if as_json:
        _output.print_json({"schema": SCHEMA, "findings": [f.document() for f in found]})
    else:
        for finding in found:
            _output.print_message(finding.message)
        if not found:
            _output.print_message(Message("plant-whole"))
    return 1 if found else 0


def retire(config: Path) -> int:
    """Removes raw frames that are older than plant.yaml keeps them; their hashes stay."""
    from station.wiring.plant import retire_frames

    count, size = retire_frames(load_plant(config))
    _output.print_message(Message("plant-retired", count=count, megabytes=size / 1e6))
    return 0


def _local(time_ns: int) -> datetime:
    return datetime.fromtimestamp(time_ns / 1e9, UTC).astimezone()
