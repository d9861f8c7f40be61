"""Who serves the line's state, from the line's file beside the log."""

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Literal

from station.adapters.line_servers.facts import LineFacts, facts_of
from station.adapters.line_servers.modbus import serve_modbus
from station.adapters.line_servers.opcua import serve_opcua
from station.adapters.line_servers.serving import ServedLine, serve_until_interrupted
from station.files.json_text import NOT_AS_EXPECTED
from station.messages import Message, render
from station.panel_protocol.line_adjustment import send_line_adjustment
from station.panel_protocol.line_state import read_line_state, send_line_command


def serve(how: Literal["opcua", "modbus"], host: str, port: int, database: Path, ready: Callable[[str], None]) -> None:
    """Serves until it is interrupted. Errors: StationFault, ConfigError."""
    facts, send = partial(line_facts, database), partial(send_line_command, database)
    line = ServedLine(host, port, facts, send, ready, partial(send_line_adjustment, database))
    serve_until_interrupted(serve_opcua if how == "opcua" else serve_modbus, line)


def line_facts(database: Path) -> LineFacts:
    """What the line says now."""
    document = read_line_state(database)
    why = render(Message.of(document["why"])) if document and document.get("why") else ""
    try:
        return facts_of(document, why, alive=document is not None and is_alive(int(document["pid"])))
    except NOT_AS_EXPECTED:  # nobody but the line writes it so
        return facts_of(None, "", alive=False)


def is_alive(pid: int) -> bool:
    """Whether that process is there."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
