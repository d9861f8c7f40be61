"""The face of `station flash`."""

from pathlib import Path

from station.cli import _output
from station.messages import Message
from station.wiring.flash import flash_unit
from station.wiring.run_order import RunOrder


def flash_and_print(order: RunOrder, path: Path, serial: str, nest: str | None, *, as_json: bool) -> int:
    """Flashes, and says what came of it; exit code 0."""

    def tell(message: Message) -> None:
        if not as_json:
            _output.print_message(message)

    result = flash_unit(order, path, serial, nest, tell)
    done = result.flashed
    if as_json:
        _output.print_json(
            {
                "schema": "station.flash/1",
                "serial": serial,
                "how": done.how,
                "version": result.version,
                "software_id_before": done.before,
                "software_id": done.after,
                "download_s": done.download_s,
            }
        )
    elif done.how == "stays":
        tell(Message("flash-stays", serial=serial, software_id=done.after))
    else:
        version = result.version or Message("program-without-version")
        values = {"serial": serial, "version": version, "software_id": done.after}
        tell(Message("flash-done", download_s=done.download_s, **values))
    return 0
