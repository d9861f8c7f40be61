"""An engineer takes note of what speaks against the log or its accounts: sealed into the log, shown for ever."""

from pathlib import Path

from station.adapters.clock import SystemClock
from station.adapters.store.log_anchors import ACKNOWLEDGED_EVENT, Acknowledgement, detail_of
from station.config.settings import Settings
from station.domain.records.head import AnchorFinding
from station.messages import Message
from station.panel_protocol import accounts
from station.panel_protocol.account_seal import altered_accounts, seal_accounts, seal_in_store
from station.ports.store import Store
from station.wiring.logs import open_log, open_store


def acknowledge(path: Path, settings: Settings, by: str, reason: str) -> list[Message]:
    """Seals into the log that an engineer goes on with it although its heads or its accounts speak against it; what
    was taken note of.

    Errors: LogError where there is no log; StoreFault; ConfigError.
    """
    note = Acknowledgement(by, reason)
    with open_log(path) as log:
        before = len(log.acknowledgements())
    with open_store(path, settings, SystemClock().epoch_ns, note) as store:
        _acknowledge_accounts(store, path, note)
    with open_log(path) as log:
        new = log.acknowledgements()[before:]
    return [Message.of(f["message"]) for acknowledgement in new for f in acknowledgement["findings"]]


def _acknowledge_accounts(store: Store, database: Path, note: Acknowledgement) -> None:
    """The accounts as they are now are those that count from here on."""
    seal = seal_in_store(store, database)
    if seal is None or not seal.file.exists():
        return
    altered = altered_accounts(accounts.load(seal.file), seal.file, seal)
    found = [AnchorFinding("edited", seal.file.name, seal.number, message) for message in altered]
    if found:
        store.event("", ACKNOWLEDGED_EVENT, detail_of(note, found))
        seal_accounts(store, database, seal.file, note.by)
