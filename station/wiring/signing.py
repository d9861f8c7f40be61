"""A person's signature goes into the log, and the page's journal with it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from station.config.settings import Settings
from station.domain.records.stored_attempt import SIGNED
from station.panel_protocol.accounts import Account
from station.panel_protocol.journal_seal import seal_journal
from station.panel_protocol.signature import SignatureWish, check_wish, signature_detail
from station.wiring.logs import open_store_now


def seal_signature(
    database: Path, settings: Settings, who: Account, stored: Mapping[str, Any], wish: SignatureWish
) -> None:
    """Seals the signature under an attempt. The password has been checked.

    Errors: UsageError where this person may not sign so; StoreFault, also while a run holds the log.
    """
    check_wish(who, stored, wish)
    with open_store_now(database, settings) as store:
        store.event(stored["attempt"], SIGNED, signature_detail(who, stored, wish))
        seal_journal(store, database)
