"""What people seal into the log at any time: by a short opening, or by the run that has the log open."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from station.config.settings import Settings
from station.errors import StoreFault
from station.panel_protocol.sealing_socket import hand_over
from station.ports.store import Store
from station.wiring.logs import open_store_now


def seal_now(
    database: Path, settings: Settings, write: Callable[[Store], None], kind: str, document: Mapping[str, Any]
) -> None:
    """Opens the log for a moment and writes; where a run or a line holds it, hands `document` over to that.

    Errors: LogError; StoreFault, also where the owner takes nothing; UsageError with which the owner refuses it.
    """
    try:
        with open_store_now(database, settings) as store:
            write(store)
    except StoreFault as fault:
        if fault.message.id != "in-use" or not hand_over(database, kind, document):
            raise
