"""A person's signature under an attempt: who, when, with what meaning, bound to the record that is signed.

As 21 CFR 11.50, 11.70 and 11.200 want it: the name and a password given for this one act, the meaning in words, and the
seal of the attempt's end inside what the log seals, so that no signature can be moved to another attempt.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from station.domain.core.types import Outcome
from station.domain.records.stored_attempt import SIGNED, signatures
from station.errors import UsageError
from station.panel_protocol.account_seal import seal_in_store
from station.panel_protocol.accounts import Account
from station.panel_protocol.journal_seal import seal_journal
from station.ports.store import Store

LONGEST_COMMENT = 200


class Meaning(StrEnum):
    """What a signature states."""

    REVIEWED = "reviewed"
    RELEASED = "released"


@dataclass(frozen=True, slots=True)
class SignatureWish:
    """What a person wants to sign with: one of Meaning, and a comment or nothing."""

    meaning: str
    comment: str = ""


def check_wish(who: Account, stored: Mapping[str, Any], wish: SignatureWish) -> None:
    """Errors: UsageError where this person may not sign this attempt so."""
    if not who.may("sign"):
        raise UsageError("sign-not-allowed", name=who.name, role=who.role.value)
    if wish.meaning not in tuple(Meaning):
        raise UsageError("sign-meaning-unknown", meaning=wish.meaning[:40], meanings=tuple(Meaning))
    if len(wish.comment) > LONGEST_COMMENT or not wish.comment.isprintable():
        raise UsageError("sign-comment-form", limit=LONGEST_COMMENT)
    if stored["seal"] is None:
        raise UsageError("sign-not-ended", serial=str(stored["serial"]))
    if wish.meaning == Meaning.RELEASED and stored["outcome"] != Outcome.PASS:
        raise UsageError("sign-not-passed", serial=str(stored["serial"]), outcome=str(stored["outcome"]))
    if any(s["by"] == who.name and s["meaning"] == wish.meaning for s in signatures(stored)):
        raise UsageError("sign-twice", name=who.name, serial=str(stored["serial"]), meaning=wish.meaning)


def signature_detail(who: Account, stored: Mapping[str, Any], wish: SignatureWish) -> dict[str, Any]:
    """As the log seals it: with the seal of the attempt's end."""
    seal = stored["seal"]
    return {
        "by": who.name,
        "role": who.role.value,
        "meaning": wish.meaning,
        "comment": wish.comment,
        "record": seal["number"],
        "seal": seal["hash"],
    }


def seal_signature_detail(store: Store, database: Path, attempt: str, detail: Mapping[str, Any]) -> None:
    """Seals a signature, and the page's journal with it.

    Errors: UsageError where the log has sealed no such person in that role; StoreFault.
    """
    seal, name = seal_in_store(store, database), str(detail["by"])
    if seal is not None and seal.roles.get(name) != detail["role"]:
        raise UsageError("account-not-sealed", file=str(seal.file), name=name, number=seal.number)
    store.event(attempt, SIGNED, detail)
    seal_journal(store, database)
