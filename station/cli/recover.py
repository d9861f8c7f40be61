"""`station recover`: a unit that an interrupted attempt may have left half written."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from station.cli._options import AsJson, ConfigPath, LogPath
from station.errors import UsageError


def command(
    serial: Annotated[str, Argument(help="Printed serial of the unit; it sits in the nest and has power.")],
    restore: Annotated[bool, Option("--restore", help="Bring the old values back.")] = False,
    go_on: Annotated[bool, Option("--continue", help="Finish writing the new values.")] = False,
    nest: Annotated[str | None, Option(help="Where it sits; left out: the first nest.")] = None,
    recipe: Annotated[str | None, Option(help="Recipe of its product.")] = None,
    config: ConfigPath = None,
    db: LogPath = None,
    simulate: Annotated[bool, Option("--simulate", help="Simulated device; needs --device-state.")] = False,
    device_state: Annotated[Path | None, Option(help="With --simulate: the devices' non-volatile memory.")] = None,
    interface: Annotated[str | None, Option(help="Bus interface, in place of config.yaml's.")] = None,
    channel: Annotated[str | None, Option(help="Bus channel, in place of config.yaml's.")] = None,
    json: AsJson = False,
) -> int:
    """Read back what a half-written unit holds; bring the old values back, or finish the new ones.

    Say only what it holds, and change nothing:

        station recover SN0044

    Bring the values back that it held before the interrupted attempt:

        station recover SN0044 --restore
    """
    from station.cli._recover import recover_unit
    from station.wiring.run_order import RunOrder

    if restore and go_on:
        raise UsageError("recover-one-way")
    order = RunOrder(
        recipe=recipe,
        config=config,
        database=db,
        simulate=simulate,
        device_state=device_state,
        interface=interface,
        channel=channel,
    )
    how = "restore" if restore else "continue" if go_on else None
    return recover_unit(order, serial, nest, how, as_json=json)
