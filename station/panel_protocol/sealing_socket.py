"""What people seal into a log while a run or a line holds it: they hand it to that process, which alone may write.

A datagram socket beside the log (mode 0600) takes changes of accounts, signatures and issued certificates. Only the
user whose process it is may hand something over: whoever that is could write the log itself. The process checks for
itself what the log knows.
"""

import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from station.errors import InputError, StationError, StoreFault, UsageError
from station.files.json_text import NOT_AS_EXPECTED, parse_json
from station.messages import Message
from station.panel_protocol.account_seal import AccountChange, apply_change
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.owner_socket import answering_requests, ask
from station.panel_protocol.signature import seal_signature_detail
from station.ports.store import Store
from station.service.certificates import seal_issued_files

_MODE = 0o600
_SEALED = b"sealed"
#: A commit waits for the disk, and for a commit of the run.
PATIENCE_S = 10.0


@contextmanager
def taking_requests(store: Store, database: Path) -> Iterator[None]:
    """Inside, what others hand over for this log is sealed into it."""
    kinds: Mapping[str, Callable[[Mapping[str, Any]], None]] = {
        "account": lambda given: apply_change(store, database, Path(given["file"]), AccountChange.of(given)),
        "signature": lambda given: seal_signature_detail(store, database, str(given["attempt"]), given["detail"]),
        "certificate": lambda given: seal_issued_files(store, str(given["attempt"]), given["files"]),
    }

    def answer(request: bytes, user: int) -> bytes | None:
        if user not in (os.geteuid(), 0):
            return None
        try:
            given = parse_json(request)
            kinds[given["kind"]](given)
        except StationError as error:
            return json.dumps({"refused": error.message.document(), "input": isinstance(error, InputError)}).encode()
        except NOT_AS_EXPECTED:
            return None
        return _SEALED

    with answering_requests(companion_file(database, Companion.SEALING), _MODE, answer, "sealing"):
        yield


def hand_over(database: Path, kind: str, document: Mapping[str, Any]) -> bool:
    """Whether the owner of the log has sealed it; False where nobody takes anything.

    Errors: what the owner refuses it with, as a UsageError or StoreFault.
    """
    request = json.dumps({"kind": kind, **document}).encode()
    answer = ask(database, Companion.SEALING, request, PATIENCE_S)
    if answer is None or answer == _SEALED:
        return answer is not None
    refused = parse_json(answer)
    raise (UsageError if refused["input"] else StoreFault)(Message.of(refused["refused"]))
