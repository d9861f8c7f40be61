"""What a unit in a load holds and how far it has come: its states, with their transition table."""

from enum import StrEnum

from station.domain.run.transitions import TransitionTable


class UnitState(StrEnum):
    """Where one attempt stands.

    seated: nothing is known of the unit, nothing touched · identified: it is the unit of the label · prepared: settings
    and output may be switched for measuring · writing: some objects may hold new values · written: all hold them, in
    working memory · saving: the save command is on its way, the flash may hold either · restarted: it came back from a
    reset, what it holds is not read yet · stored: all new values were read back after the reset · verified: its own
    output was right, and it is still the same device with the same values · changed: it no longer is · put-back: all
    old values stand in working memory again · reverted: all old values were read back after a reset · closed: the
    attempt has its outcome.
    """

    SEATED = "seated"
    IDENTIFIED = "identified"
    PREPARED = "prepared"
    WRITING = "writing"
    WRITTEN = "written"
    SAVING = "saving"
    RESTARTED = "restarted"
    STORED = "stored"
    VERIFIED = "verified"
    CHANGED = "changed"
    PUT_BACK = "put-back"
    REVERTED = "reverted"
    CLOSED = "closed"


_S = UnitState

#: The only ways on. A unit may be closed from everywhere: a fault, a stop, or a limit that it fails.
UNIT_STATES = TransitionTable(
    "the unit",
    {
        _S.SEATED: frozenset({_S.IDENTIFIED, _S.CLOSED}),
        _S.IDENTIFIED: frozenset({_S.PREPARED, _S.CLOSED}),
        _S.PREPARED: frozenset({_S.PREPARED, _S.WRITING, _S.CLOSED}),  # again after it was turned in its seat
        _S.WRITING: frozenset({_S.WRITTEN, _S.RESTARTED, _S.PUT_BACK, _S.CLOSED}),
        _S.WRITTEN: frozenset({_S.SAVING, _S.RESTARTED, _S.PUT_BACK, _S.CLOSED}),
        _S.SAVING: frozenset({_S.RESTARTED, _S.CLOSED}),
        _S.RESTARTED: frozenset({_S.STORED, _S.REVERTED, _S.CLOSED}),
        _S.STORED: frozenset({_S.VERIFIED, _S.CHANGED, _S.CLOSED}),
        _S.VERIFIED: frozenset({_S.CLOSED}),
        _S.CHANGED: frozenset({_S.CLOSED}),
        _S.PUT_BACK: frozenset({_S.CLOSED}),
        _S.REVERTED: frozenset({_S.CLOSED}),
        _S.CLOSED: frozenset(),
    },
)

#: Output or settings may not be as they were found; a reset brings them back.
SWITCHED = frozenset({_S.PREPARED, _S.WRITING, _S.WRITTEN, _S.SAVING, _S.PUT_BACK})
#: Coefficients may differ from those it came with, and nobody has read which it holds.
UNCERTAIN = frozenset({_S.WRITING, _S.WRITTEN, _S.SAVING, _S.RESTARTED})
#: The new coefficients are saved, and were read back after a reset.
HOLDS_NEW = frozenset({_S.STORED, _S.VERIFIED})
