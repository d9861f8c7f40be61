"""Which adapter a log is read by, and what a check of it may rely on."""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from station.adapters.clock import SystemClock
from station.adapters.store import keys
from station.adapters.store.anchor import AnchorFolder, folders_of_one_fate
from station.adapters.store.log_anchors import Acknowledgement
from station.adapters.store.pkcs11_signer import SCHEME, open_signer
from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.adapters.witness.head_file import TreeHeadFile
from station.config.settings import Settings
from station.domain.records.head import SealedHead
from station.errors import ConfigError, LogError, StoreFault
from station.files.real_path import real_path
from station.messages import Message
from station.ports.log_reader import LogReader, Trust
from station.service.witness import Witness

if TYPE_CHECKING:
    from station.adapters.witness.client import WitnessClient


def open_log(path: Path | str) -> LogReader:
    """The log, to be read: a file, or the records of a plant at an address of PostgreSQL. Errors: LogError."""
    if address := plant_address(path):
        return _open_plant_log(address)
    return SqliteLogReader(Path(path))


def find_log(path: Path) -> LogReader | None:
    """The log, to be read; None where nothing was ever run. Errors: LogError."""
    return open_log(path) if plant_address(path) or path.exists() else None


def check_is_log(path: Path) -> None:
    """LogError where there is a file that is no log; one of an older version, or an empty one, will do."""
    try:
        log = find_log(real_path(path))
    except LogError as exc:
        reason = exc.message.parameters.get("reason")
        if exc.message.id == "log-other-database" or (isinstance(reason, Message) and reason.id == "log-no-database"):
            raise
        return
    if log is not None:
        log.close()


def plant_address(path: Path | str) -> str:
    """The address of PostgreSQL that stands in the place of a file; "" for a file.

    A path has one slash of the two or three after the colon left. A single word there is then the database of this
    machine's own server, `postgresql:///plant`, not a host without a database.
    """
    scheme, _, rest = str(path).partition(":/")
    if scheme not in ("postgresql", "postgres"):
        return ""
    if isinstance(path, str):
        return f"postgresql:/{rest}"
    return f"postgresql://{rest}" if "/" in rest.partition("?")[0] else f"postgresql:///{rest}"


def _open_plant_log(address: str) -> LogReader:
    try:
        from station.adapters.postgres.reader import PostgresLogReader
    except StoreFault as error:
        raise LogError(error.message) from error
    from station.adapters.objects.store import open_objects

    return PostgresLogReader(address, open_objects)


def trust_of(known: Mapping[int, bytes], key: Path | None, log: Path, settings: Settings | None) -> Trust:
    """Trust in seals by record number, in the public key in a PEM file, and in the heads kept in the station's anchors.

    Errors: UsageError.
    """
    heads = dict[str, SealedHead | None]()
    for place in anchor_folders(log, settings) if settings else ():
        try:
            heads[place.name] = place.read()
        except (OSError, ValueError):
            heads[place.name] = None
    pinned = key or (Path(settings.trusted_key) if settings and settings.trusted_key else None)
    return Trust(known, keys.load_public_key(pinned) if pinned else None, heads)


def anchor_folders(log: Path, settings: Settings) -> list[AnchorFolder]:
    """Where the heads of a log are kept elsewhere: in the folders of config.yaml, by station and name of the log."""
    return [AnchorFolder(Path(a.folder), f"{settings.station}-{log.stem}", a.write_once) for a in settings.anchors]


def open_store(
    path: Path,
    settings: Settings,
    epoch_ns: Callable[[], int],
    acknowledgement: Acknowledgement | None = None,
    *,
    brief: bool = False,
) -> SqliteStore:
    """The station's log, to be written. brief: for a moment; a run that begins waits for it.

    Errors: StoreFault, ConfigError.
    """
    signer = signer_of(settings.signing_key) if settings.signing_key else None
    folders = anchor_folders(path, settings)
    if one := folders_of_one_fate(path, folders):
        raise ConfigError("anchors-one-folder", first=one[0], second=one[1])
    witness = _witness(settings, signer) if settings.witness and signer else None
    return SqliteStore(
        path,
        settings.station,
        epoch_ns,
        signer,
        anchors=folders,
        acknowledgement=acknowledgement,
        witness=witness,
        brief=brief,
    )


def open_store_now(path: Path, settings: Settings) -> SqliteStore:
    """The same by the clock of this machine, for what people seal into a log that exists. Errors: LogError as well."""
    open_log(path).close()
    return open_store(path, settings, SystemClock().epoch_ns, brief=True)


def _witness(settings: Settings, signer: keys.Signer) -> "WitnessClient | None":
    at = settings.witness
    if at is None:
        return None
    from station.adapters.witness.client import WitnessClient

    key = keys.load_public_key(Path(at.public_key))
    return WitnessClient(at.url, settings.station, signer.public_key, signer.sign, key, keys.verify, at.timeout_s)


@contextmanager
def open_witness(heads: Path, key: Path, stations: Mapping[str, Path]) -> Iterator[Witness]:
    """A witness that keeps its heads in a file. stations: PEM files of the public keys that alone are served, by name.

    Errors: ConfigError, UsageError, StoreFault.
    """
    signer = keys.load_signer(key)
    known = {name: keys.load_public_key(path) for name, path in stations.items()}
    head_file = TreeHeadFile(heads)
    head_file.open()
    try:
        yield Witness(head_file, SystemClock(), signer.sign, keys.verify, known)
    finally:
        head_file.close()


def signer_of(key: str) -> keys.Signer:
    """The key that config.yaml names: a PEM file, or a key in a hardware module. Errors: ConfigError.

    STATION_KEY_PASSPHRASE opens an encrypted file; STATION_PKCS11_MODULE and _PIN reach a module.
    """
    if key.startswith(SCHEME):
        return open_signer(key, os.environ.get("STATION_PKCS11_MODULE", ""), os.environ.get("STATION_PKCS11_PIN", ""))
    passphrase = os.environ.get("STATION_KEY_PASSPHRASE", "")
    return keys.load_signer(Path(key), passphrase.encode() or None)


def rotate_key(path: Path, settings: Settings, new: str) -> str:
    """Hands the log over from the station's key to a new one, by a record that both sign; the new public key, hex.

    Errors: LogError where there is no log; ConfigError, StoreFault.
    """
    open_log(path).close()
    old, signer = signer_of(settings.signing_key), signer_of(new)
    folders = anchor_folders(path, settings)
    SqliteStore(path, settings.station, SystemClock().epoch_ns, signer, anchors=folders, old_signer=old).close()
    return signer.public_key.hex()


def revoke_key(path: Path, settings: Settings, key: Path, beyond: int, by: str, reason: str) -> None:
    """Seals into the log that a key is not trusted beyond a record. Errors: LogError, ConfigError, StoreFault."""
    public = keys.load_public_key(key)
    with open_store_now(path, settings) as store:
        detail = {"public_key": public.hex(), "beyond": beyond, "by": by, "reason": reason}
        store.event("", keys.REVOKED_EVENT, detail)


def public_key_of_signer(path: Path) -> bytes:
    """The public half of the station's key, 32 bytes. Errors: ConfigError."""
    return keys.load_signer(path).public_key
