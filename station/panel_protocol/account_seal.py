"""The page's accounts sealed into the log: whoever edits accounts.json to act in another's name is refused and found.

Each change is an event of the station: who may log in, in what role, and a hash of each account. A person whose account
is not as it was sealed last cannot log in or sign; `station audit --verify` names them. Where the log has sealed nobody
yet, the first seal takes the accounts as they are.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from station.domain.records.chain import IntegrityFinding
from station.errors import UsageError
from station.files.real_path import real_path
from station.messages import Message
from station.panel_protocol import accounts
from station.panel_protocol.accounts import Account, Role
from station.ports.log_reader import LogReader
from station.ports.store import Store

SEALED_EVENT = "accounts-sealed"


@dataclass(frozen=True, slots=True)
class AccountChange:
    """account: as it is to be; None: the person is removed. by: who vouches for it, "" for nobody."""

    name: str
    account: Account | None
    by: str = ""

    def document(self) -> dict[str, Any]:
        """As it is handed over."""
        account = self.account and {"role": self.account.role.value, "password": self.account.password}
        return {"name": self.name, "account": account, "by": self.by}

    @staticmethod
    def of(document: Mapping[str, Any]) -> "AccountChange":
        """What `document()` described. Errors: NOT_AS_EXPECTED of station.files.json_text."""
        name, given = str(document["name"]), document["account"]
        account = given and Account(name, Role(given["role"]), str(given["password"]))
        return AccountChange(name, account, str(document["by"]))


@dataclass(frozen=True, slots=True)
class AccountsSeal:
    """The newest seal. number: of its record; file: where the accounts are kept; roles, hashes: by name."""

    number: int
    file: Path
    roles: Mapping[str, str]
    hashes: Mapping[str, str]

    @property
    def has_engineer(self) -> bool:
        """Whether somebody is there who may vouch for a change."""
        return Role.ENGINEER in self.roles.values()

    def vouches(self, change: AccountChange) -> bool:
        """Whether who vouches for the change may: an engineer for any, everybody for a new password of their own."""
        role = self.roles.get(change.by)
        own = change.account is not None and change.name == change.by and change.account.role == role
        return not self.has_engineer or role == Role.ENGINEER or own

    def holds(self, account: Account) -> bool:
        """Whether the account is as it was sealed."""
        return self.hashes.get(account.name) == account_hash(account)


def account_hash(account: Account) -> str:
    """SHA-256 over name, role and the stored form of the password, which cannot be guessed from it."""
    row = ["station.account/1", account.name, account.role.value, account.password]
    return hashlib.sha256(json.dumps(row).encode()).hexdigest()


def seal_in_log(log: LogReader, database: Path) -> AccountsSeal | None:
    """The newest seal of a log that is read; None where there is none."""
    found = log.station_events(SEALED_EVENT, 1)
    return _parse(found[-1].number, json.loads(found[-1].detail), database) if found else None


def seal_in_store(store: Store, database: Path) -> AccountsSeal | None:
    """The newest seal of a log that is written; None where there is none. Errors: StoreFault."""
    found = store.station_events(SEALED_EVENT, 1)
    return _parse(found[-1][0], found[-1][2], database) if found else None


def seal_accounts(store: Store, database: Path, file: Path, by: str = "") -> None:
    """Seals all accounts as their file has them now. by: who vouches for them. Errors: StoreFault, ConfigError."""
    people = accounts.load(file).values()
    _seal(store, database, file, {p.name: (p.role.value, account_hash(p)) for p in people}, by)


def seal_account(store: Store, database: Path, file: Path, name: str, by: str) -> None:
    """Seals one person's account, or that it is no more; the others stay as they were sealed.

    Errors: StoreFault, ConfigError.
    """
    before = seal_in_store(store, database)
    if before is None:
        return seal_accounts(store, database, file, by)
    rows = {known: (before.roles[known], hash_) for known, hash_ in before.hashes.items() if known != name}
    if account := accounts.load(file).get(name):
        rows[name] = (account.role.value, account_hash(account))
    return _seal(store, database, file, rows, by)


def apply_change(store: Store, database: Path, file: Path, change: AccountChange) -> None:
    """Writes the change into the file of the people and seals it.

    Errors: UsageError where the log knows of nobody who may vouch for it so; StoreFault, ConfigError.
    """
    seal = seal_in_store(store, database)
    if seal is not None and not seal.vouches(change):
        role = seal.roles.get(change.by, "")
        raise UsageError("account-by-no-engineer", name=change.by, role=role)
    write_change(file, change)
    seal_account(store, database, file, change.name, change.by)


def write_change(file: Path, change: AccountChange) -> None:
    """The file of the people with the change. Errors: ConfigError."""
    people = accounts.load(file)
    people.pop(change.name, None)
    if change.account is not None:
        people[change.name] = change.account
    accounts.save(file, people)


def seal_first_accounts(store: Store, database: Path, file: Path) -> None:
    """Seals the accounts as they are, where the log has sealed none yet. Errors: StoreFault, ConfigError."""
    if seal_in_store(store, database) is None and accounts.load(file):
        seal_accounts(store, database, file)


def check_sealed(account: Account, file: Path, seal: AccountsSeal | None) -> None:
    """Errors: UsageError where the log has sealed the person otherwise, or not at all."""
    if seal is not None and not seal.holds(account):
        raise UsageError("account-not-sealed", file=str(file), name=account.name, number=seal.number)


def altered_accounts(people: Mapping[str, Account], file: Path, seal: AccountsSeal) -> Iterator[Message]:
    """Who is not as sealed: added, changed or removed."""
    for name in sorted({*people, *seal.hashes}):
        account = people.get(name)
        if account is None:
            yield Message("account-removed", file=str(file), name=name, number=seal.number)
        elif name not in seal.hashes:
            yield Message("account-added", file=str(file), name=name, number=seal.number)
        elif not seal.holds(account):
            yield Message("account-changed", file=str(file), name=name, number=seal.number)


def account_findings(log: LogReader, database: Path) -> tuple[AccountsSeal | None, list[IntegrityFinding]]:
    """The newest seal, and who is not as sealed; without the file nobody can log in, and nothing is found.

    Errors: ConfigError where the file cannot be read.
    """
    seal = seal_in_log(log, database)
    if seal is None or not seal.file.exists():
        return seal, []
    altered = altered_accounts(accounts.load(seal.file), seal.file, seal)
    return seal, [IntegrityFinding("edited", "accounts", seal.number, message) for message in altered]


def _seal(store: Store, database: Path, file: Path, rows: Mapping[str, tuple[str, str]], by: str) -> None:
    people = [{"name": name, "role": role, "sha256": hash_} for name, (role, hash_) in rows.items()]
    folder, real = real_path(database).parent, real_path(file)
    shown = real.name if real.parent == folder else str(real)  # a log that is moved takes the file along
    store.event("", SEALED_EVENT, {"file": shown, "by": by, "people": people})


def _parse(number: int, detail: Mapping[str, Any], database: Path) -> AccountsSeal:
    people = detail["people"]
    file = real_path(database).parent / str(detail["file"])
    return AccountsSeal(number, file, {p["name"]: p["role"] for p in people}, {p["name"]: p["sha256"] for p in people})
