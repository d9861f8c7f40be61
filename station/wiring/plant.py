"""plant.yaml → a plant: which adapters it stands on."""

import hashlib
import os
import secrets
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from station.adapters.clock import SystemClock
from station.adapters.store import keys
from station.config.plant import PlantSettings
from station.domain.records.chain import IntegrityFinding
from station.ports.clock import Clock
from station.ports.objects import ObjectStore
from station.service.receiver import PlantReceiver, RegisteredStation
from station.service.witness import Witness

if TYPE_CHECKING:
    from station.adapters.postgres.plant import PostgresPlant

#: Stands in for `database` of plant.yaml, so that a password need not stand in a file.
ADDRESS_VARIABLE = "STATION_PLANT_DATABASE"


@dataclass(frozen=True, slots=True)
class Plant:
    """The parts of one plant."""

    store: "PostgresPlant"
    receiver: PlantReceiver
    witness: Witness | None
    stations: tuple[tuple[RegisteredStation, str | None, str], ...]
    objects: ObjectStore
    clock: Clock


def check_public_key(path: Path) -> None:
    """UsageError where a file is no public key of a station."""
    keys.load_public_key(path)


@contextmanager
def open_plant(settings: PlantSettings) -> Iterator[Plant]:
    """The plant, its database brought to this version's schema. Errors: ConfigError, UsageError, StoreFault."""
    from station.adapters.objects.store import open_objects
    from station.adapters.postgres.connections import Connections
    from station.adapters.postgres.plant import PostgresPlant
    from station.adapters.postgres.schema import migrate, note_objects
    from station.adapters.postgres.signatures import verify
    from station.adapters.postgres.tree_heads import PostgresTreeHeads

    stations = tuple(
        (RegisteredStation(s.name, keys.load_public_key(Path(s.public_key))), s.token_sha256, s.certificate)
        for s in settings.stations
    )
    signer = keys.load_signer(Path(settings.signing_key)) if settings.signing_key else None
    objects = open_objects(settings.objects)
    connections = Connections(database_address(settings))
    try:
        migrate(connections)
        note_objects(
            connections, settings.objects if "://" in settings.objects else str(Path(settings.objects).resolve())
        )
        names = {s.name: frozenset({s.name, *s.former_names}) for s in settings.stations}
        store = PostgresPlant(connections, objects, names)
        clock = SystemClock()
        public = {station.name: station.public_key for station, _, _ in stations}
        witness = Witness(PostgresTreeHeads(connections), clock, signer.sign, verify, public) if signer else None
        yield Plant(store, PlantReceiver(store, clock, verify), witness, stations, objects, clock)
    finally:
        connections.close()


def database_address(settings: PlantSettings) -> str:
    """Of the environment, else of plant.yaml."""
    return os.environ.get(ADDRESS_VARIABLE) or settings.database


def new_token() -> tuple[str, str]:
    """A station's token, and its SHA-256 in hex, which alone is kept."""
    token = secrets.token_urlsafe(32)
    return token, hashlib.sha256(token.encode()).hexdigest()


def plant_findings(settings: PlantSettings) -> Iterator[IntegrityFinding]:
    """Everything wrong with the chains that the plant has. Errors: LogError."""
    from station.wiring.logs import open_log

    with open_log(database_address(settings)) as log:
        yield from log.findings()


def grant_reader(settings: PlantSettings, name: str, stations: Sequence[str], products: Sequence[str]) -> None:
    """Lets a database role see those stations and products, all where none is named. Errors: StoreFault."""
    from station.adapters.postgres.connections import Connections
    from station.adapters.postgres.readers import grant

    connections = Connections(database_address(settings))
    try:
        grant(connections, name, stations, products)
    finally:
        connections.close()


def retire_frames(settings: PlantSettings) -> tuple[int, int]:
    """Removes raw frames that are older than the settings keep them: how many attempts', how many bytes.

    Errors: StoreFault.
    """
    from station.adapters.objects.store import open_objects
    from station.adapters.postgres.connections import Connections
    from station.adapters.postgres.retention import retire

    connections = Connections(database_address(settings))
    days = settings.retention.pass_days, settings.retention.other_days
    try:
        return retire(connections, open_objects(settings.objects), days, SystemClock().epoch_ns())
    finally:
        connections.close()
