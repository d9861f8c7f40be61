"""Changes of the page's accounts: written into their file and sealed into the log, or left for an engineer to seal."""

from functools import partial
from pathlib import Path

from station.config.settings import Settings
from station.files.real_path import real_path
from station.panel_protocol.account_seal import AccountChange, AccountsSeal, apply_change, seal_in_log, write_change
from station.wiring.logs import find_log
from station.wiring.sealing import seal_now


def known_seal(database: Path) -> AccountsSeal | None:
    """What the log has sealed of the accounts; None where there is no log, or nothing is sealed. Errors: LogError."""
    log = find_log(database)
    if log is None:
        return None
    with log:
        return seal_in_log(log, database)


def change_account(database: Path, settings: Settings, file: Path, change: AccountChange) -> bool:
    """Writes the change and seals it; False where it is not sealed, as nobody vouches for it and somebody could.

    Where nothing was ever run there is no log: its first seal will take the accounts as they are. A run or a line that
    holds the log does both. Errors: UsageError, ConfigError, StoreFault.
    """
    seal = known_seal(database)
    sealing = change.by or seal is None or not seal.has_engineer
    if not sealing or not database.exists():
        write_change(file, change)
        return bool(sealing)
    document = {"file": str(real_path(file)), **change.document()}
    write = partial(apply_change, database=database, file=file, change=change)
    seal_now(database, settings, write, "account", document)
    return True
