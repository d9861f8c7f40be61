"""The work of `station stop --kill`: an engineer ends a run that no stop ends."""

from dataclasses import dataclass
from pathlib import Path

from station.cli import _output
from station.errors import UsageError
from station.messages import Message
from station.panel_protocol import accounts
from station.panel_protocol.account_seal import check_sealed
from station.panel_protocol.accounts import Role
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.journal import Journal
from station.panel_protocol.stop import kill_owner, require_owner
from station.wiring.accounts import known_seal


@dataclass(frozen=True, slots=True)
class KillRequest:
    """kill: it is wanted; by: who vouches for it; people: file of the accounts, None: beside the log."""

    kill: bool
    by: str | None
    people: Path | None
    as_json: bool


def kill_run(database: Path, request: KillRequest) -> int:
    """Asks for the engineer's password, writes it into the page's journal, and ends the process.

    Errors: UsageError where there is no run, or nobody who may; ConfigError, StationFault, StoreFault.
    """
    if not request.kill or request.by is None:
        raise UsageError("kill-needs-engineer")
    pid = require_owner(database)
    _check_engineer(database, request.people or database.with_name("accounts.json"), request.by)
    Journal(companion_file(database, Companion.JOURNAL)).add(request.by, "kill", pid=pid)
    kill_owner(database, pid)
    if request.as_json:
        _output.print_json({"schema": "station.stop/1", "database": str(database), "pid": pid})
    else:
        _output.print_message(Message("run-killed", pid=pid))
    return 0


def _check_engineer(database: Path, file: Path, name: str) -> None:
    who = accounts.load(file).get(name)
    if who is None:
        raise UsageError("sign-nobody", file=str(file), name=name[:64])
    if who.role is not Role.ENGINEER:
        raise UsageError("kill-by-no-engineer", name=who.name, role=who.role.value)
    check_sealed(who, file, known_seal(database))
    if not accounts.verify_password(_output.read_password(who.name), who.password):
        raise UsageError("kill-wrong-password", name=who.name)
