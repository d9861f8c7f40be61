"""While the page serves, its journal is sealed into the log again and again: lines cut off its end are found."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Thread

from station.adapters.clock import SystemClock
from station.config.settings import Settings
from station.errors import StationError
from station.panel_protocol.account_seal import seal_first_accounts
from station.panel_protocol.journal_seal import UnsealedLines, seal_journal
from station.wiring.logs import open_store_now

_EVERY_S = 1.0


@dataclass(frozen=True, slots=True)
class PageSeals:
    """Seals what the page leaves beside the log: its journal, and the first time its accounts."""

    database: Path
    settings: Settings
    accounts: Path
    unsealed: UnsealedLines

    def step(self, now_s: float) -> bool:
        """Seals when it is due; whether it did. now_s: of a clock that does not step back."""
        return self.unsealed.due(now_s) and self.seal()

    def seal(self) -> bool:
        """Seals now; False while a run holds the log, which seals for itself, or nothing was ever run."""
        size = self.unsealed.size()
        with suppress(StationError), open_store_now(self.database, self.settings) as store:
            seal_journal(store, self.database)
            seal_first_accounts(store, self.database, self.accounts)
            self.unsealed.sealed(size)
            return True
        return False


@contextmanager
def sealing_in_background(database: Path, settings: Settings, accounts: Path) -> Iterator[None]:
    """Seals at the beginning, while the block lasts, and at its end."""
    seals, over, clock = PageSeals(database, settings, accounts, UnsealedLines(database)), Event(), SystemClock()

    def keep_sealing() -> None:
        while not over.wait(_EVERY_S):
            seals.step(clock.monotonic_s())

    seals.seal()
    thread = Thread(target=keep_sealing, name="page-seals", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        seals.seal()
