"""The work of `station sign`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from station.cli import _output
from station.config.settings import load_settings
from station.errors import LogError, UsageError
from station.messages import Message
from station.panel_protocol import accounts
from station.panel_protocol.account_seal import check_sealed
from station.panel_protocol.accounts import Account
from station.panel_protocol.signature import SignatureWish, check_wish
from station.ports.log_reader import Query
from station.wiring.accounts import known_seal
from station.wiring.logs import open_log
from station.wiring.signing import seal_signature


@dataclass(frozen=True, slots=True)
class SignatureRequest:
    """What the command line says. attempt: its id, or None for the newest."""

    serial: str
    by: str
    meaning: str
    attempt: str | None
    comment: str


def sign_attempt(request: SignatureRequest, db: Path | None, config: Path | None, people: Path | None) -> int:
    """Asks for the password and seals the signature. Errors: UsageError, LogError, ConfigError, StoreFault."""
    settings = load_settings(config)
    database = db or Path(settings.database)
    stored = _stored(database, request)
    file = people or database.with_name("accounts.json")
    who = accounts.load(file).get(request.by)
    if who is None:
        raise UsageError("sign-nobody", file=str(file), name=request.by[:64])
    wish = SignatureWish(request.meaning, request.comment)
    check_wish(who, stored, wish)  # before anybody types
    check_sealed(who, file, known_seal(database))
    _check_password(who)
    seal_signature(database, settings, who, stored, wish)
    _output.print_message(
        Message("signed", serial=request.serial, attempt=stored["attempt"], meaning=request.meaning, name=who.name)
    )
    return 0


def _stored(database: Path, request: SignatureRequest) -> dict[str, Any]:
    with open_log(database) as log:
        found = log.attempts(Query(serial=request.serial))
        chosen = [a for a in found if request.attempt in (None, a.attempt)]
        if not chosen:
            raise LogError("log-no-such-attempt-of", log=log.location, serial=request.serial)
        return log.attempt(chosen[0])


def _check_password(who: Account) -> None:
    if not accounts.verify_password(_output.read_password(who.name), who.password):
        raise UsageError("sign-wrong-password", name=who.name)
