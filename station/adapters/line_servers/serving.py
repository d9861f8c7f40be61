"""What every server of the line is given, and how it runs."""

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Any

from station.adapters.line_servers.facts import LineFacts
from station.domain.cell.adjustment import LineAdjustment
from station.domain.cell.packml import Command
from station.errors import StationFault
from station.messages import system_reason


@dataclass(frozen=True, slots=True)
class ServedLine:
    """host, port: where it listens; facts: what the line says now; send, adjust: give it a command, a mode and times;
    ready: called with the address once it listens."""

    host: str
    port: int
    facts: Callable[[], LineFacts]
    send: Callable[[Command], None]
    ready: Callable[[str], None]
    adjust: Callable[[LineAdjustment], None] = lambda _: None


def serve_until_interrupted(serving: Callable[[ServedLine], Coroutine[Any, Any, None]], line: ServedLine) -> None:
    """Serves until it is interrupted. Errors: StationFault where it cannot listen, ConfigError without its package."""
    try:
        asyncio.run(serving(line))
    except OSError as exc:
        raise StationFault("line-not-listening", host=line.host, port=line.port, reason=system_reason(exc)) from exc
