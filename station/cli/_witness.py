"""The face of the witness: keys in, then a server until it is stopped."""

import socket
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from station.cli import _output
from station.errors import StationFault, UsageError
from station.messages import Message, render, system_reason


def serve_witness(key: Path, heads: Path, stations: Sequence[str], host: str, port: int) -> int:
    """Serves until SIGINT or SIGTERM. Errors: UsageError, ConfigError, StoreFault, StationFault."""
    import uvicorn

    from station.web.witness import create_witness_app, witness_connections
    from station.wiring.logs import open_witness

    # Ctrl-C is the way to stop it, and no failure.
    with (
        open_witness(heads, key, _named_keys(stations)) as witness,
        listening(host, port) as listener,
        suppress(KeyboardInterrupt),
    ):
        at = f"http://{host}:{listener.getsockname()[1]}"
        _output.print_line(render(Message("witness-serving", url=at, heads=str(heads))))
        options = uvicorn.Config(create_witness_app(witness), log_level="warning", **witness_connections())
        uvicorn.Server(options).run([listener])
    return 0


def _named_keys(stations: Sequence[str]) -> dict[str, Path]:
    found = dict[str, Path]()
    for text in stations:
        name, _, path = text.partition("=")
        if not name or not path:
            raise UsageError("witness-station-form", text=text[:80])
        found[name] = Path(path)
    return found


def listening(host: str, port: int) -> socket.socket:
    try:
        return socket.create_server((host, port))
    except (OSError, UnicodeError) as error:
        raise StationFault("witness-not-listening", host=host, port=port, reason=system_reason(error)) from error
