"""`station flash`: firmware for a unit on the fixture."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from station.cli._options import AsJson, ConfigPath

#: Options that only go with one of these words.
GOES_WITH = {"--device-state": ("--simulate",)}


def command(
    image: Annotated[Path, Argument(help="What the image is and for which devices: a station.firmware/1 file.")],
    serial: Annotated[str, Option(help="Printed serial of the unit; it sits in the nest and has power.")],
    nest: Annotated[str | None, Option(help="Where it sits; left out: the first nest.")] = None,
    recipe: Annotated[str | None, Option(help="Recipe of its product.")] = None,
    config: ConfigPath = None,
    simulate: Annotated[bool, Option("--simulate", help="Simulated device; needs --device-state.")] = False,
    device_state: Annotated[Path | None, Option(help="With --simulate: the devices' non-volatile memory.")] = None,
    interface: Annotated[str | None, Option(help="Bus interface, in place of config.yaml's.")] = None,
    channel: Annotated[str | None, Option(help="Bus channel, in place of config.yaml's.")] = None,
    json: AsJson = False,
) -> int:
    """Download firmware into a unit by 0x1F50 and 0x1F51 (CiA 302-3), and prove it by 0x1F56 and 0x1F57.

    An image for other hardware is refused before anything is written. Broken off anywhere, the same command goes on; a
    unit that runs the image already is left alone.

        station flash firmware.yaml --serial SN0044
    """
    from station.cli._flash import flash_and_print
    from station.wiring.run_order import RunOrder

    order = RunOrder(
        recipe=recipe,
        config=config,
        simulate=simulate,
        device_state=device_state,
        interface=interface,
        channel=channel,
    )
    return flash_and_print(order, image, serial, nest, as_json=json)
