"""Changes of the page's accounts: written into their file and sealed into the log, or left for an engineer to seal."""

from dataclasses import dataclass
from pathlib import Path

from station.config.settings import Settings
from station.panel_protocol import accounts
from station.panel_protocol.account_seal import AccountsSeal, seal_account, seal_in_log
from station.panel_protocol.accounts import Account
from station.wiring.logs import find_log, open_store_now


@dataclass(frozen=True, slots=True)
class AccountChange:
    """account: as it is to be; None: the person is removed. by: who vouches for it, "" for nobody."""

    name: str
    account: Account | None
    by: str = ""


def known_seal(database: Path) -> AccountsSeal | None:
    """What the log has sealed of the accounts; None where there is no log, or nothing is sealed. Errors: LogError."""
    log = find_log(database)
    if log is None:
        return None
    with log:
        return seal_in_log(log, database)


def change_account(database: Path, settings: Settings, file: Path, change: AccountChange) -> bool:
    """Writes the change and seals it; False where it is not sealed, as nobody vouches for it and somebody could.

    Where nothing was ever run there is no log: its first seal will take the accounts as they are.
    Errors: ConfigError, StoreFault, also while a run holds the log.
    """
    seal = known_seal(database)
    sealing = change.by or seal is None or not seal.has_engineer
    if not sealing or not database.exists():
        _write(file, change)
        return bool(sealing)
    with open_store_now(database, settings) as store:
        _write(file, change)
        seal_account(store, database, file, change.name, change.by)
    return True


def _write(file: Path, change: AccountChange) -> None:
    people = accounts.load(file)
    people.pop(change.name, None)
    if change.account is not None:
        people[change.name] = change.account
    accounts.save(file, people)
