"""A person's signature goes into the log, and the page's journal with it."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from station.config.settings import Settings
from station.panel_protocol.accounts import Account
from station.panel_protocol.signature import SignatureWish, check_wish, seal_signature_detail, signature_detail
from station.wiring.sealing import seal_now


def seal_signature(
    database: Path, settings: Settings, who: Account, stored: Mapping[str, Any], wish: SignatureWish
) -> None:
    """Seals the signature under an attempt. The password has been checked. A run that holds the log seals it.

    Errors: UsageError where this person may not sign so; StoreFault.
    """
    check_wish(who, stored, wish)
    attempt, detail = str(stored["attempt"]), signature_detail(who, stored, wish)
    write = partial(seal_signature_detail, database=database, attempt=attempt, detail=detail)
    seal_now(database, settings, write, "signature", {"attempt": attempt, "detail": detail})
