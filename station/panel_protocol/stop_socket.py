"""A run's own ear for a stop: a datagram socket beside the log, for the run's user and group (mode 0660)."""

import os
import pwd
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.owner_socket import answering_requests, ask

_STOP, _STOPPING = b"stop", b"stopping "
#: User and group of the run may stop it; anybody on the machine may not.
_MODE = 0o660
#: A run answers at once, whatever else it does.
PATIENCE_S = 1.0


@contextmanager
def listening_for_stop(database: Path, stop: Callable[[str], None]) -> Iterator[None]:
    """Inside, `stop` is called, in a thread of its own, with the name of whoever asks the run on this log to end.

    Only the owner of the log listens. Where the file system has no sockets, nobody does: signals remain.
    """

    def answer(request: bytes, user: int) -> bytes | None:
        if request != _STOP:
            return None
        stop(_name(user))
        return _STOPPING + str(os.getpid()).encode()

    with answering_requests(companion_file(database, Companion.STOP), _MODE, answer, "stop"):
        yield


def stop_by_socket(database: Path, patience_s: float = PATIENCE_S) -> int | None:
    """Asks the run on this log to stop; its pid. None where nobody listens, or this user may not ask."""
    answer = ask(database, Companion.STOP, _STOP, patience_s) or b""
    with suppress(ValueError):
        return int(answer.removeprefix(_STOPPING)) if answer.startswith(_STOPPING) else None
    return None


def _name(user: int) -> str:
    with suppress(KeyError):
        return pwd.getpwuid(user).pw_name
    return str(user)
