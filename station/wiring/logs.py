"""Which adapter a log is read by, and what a check of it may rely on."""

from collections.abc import Mapping
from pathlib import Path

from station.adapters.store import keys
from station.adapters.store.reader import SqliteLogReader
from station.ports.log_reader import LogReader, Trust


def open_log(path: Path) -> LogReader:
    """The log, to be read. Errors: LogError."""
    return SqliteLogReader(path)


def find_log(path: Path) -> LogReader | None:
    """The log, to be read; None where nothing was ever run. Errors: LogError."""
    return SqliteLogReader(path) if path.exists() else None


def trust_of(known: Mapping[int, bytes], key: Path | None) -> Trust:
    """Trust in seals by record number and in the public key in a PEM file. Errors: UsageError."""
    return Trust(known, keys.load_public_key(key) if key else None)


def public_key_of_signer(path: Path) -> bytes:
    """The public half of the station's key, 32 bytes. Errors: ConfigError."""
    return keys.load_signer(path).public_key
