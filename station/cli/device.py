"""`station device`: simulated devices on a CAN interface."""

from pathlib import Path
from typing import Annotated

from typer import Option


def command(
    node: Annotated[list[str], Option(help="Node id of a device, such as 0x11; repeatable.")],
    serial: Annotated[list[str], Option(help="Its printed serial, one per --node.")],
    channel: Annotated[str, Option(help="CAN interface.")] = "vcan0",
    interface: Annotated[str, Option(help="The kind of bus that --channel is on.")] = "socketcan",
    product: Annotated[str, Option(help="Product file in dbc/, by name.")] = "accelerometer",
    rate_hz: Annotated[float | None, Option(min=0.1, max=1000, help="Readings a second; left out: as the EDS.")] = None,
    seed: Annotated[int, Option(min=0, help="Seed of the units' errors and noise.")] = 1,
    memory: Annotated[Path | None, Option(help="Folder where they keep what is saved, one SERIAL.json each.")] = None,
    fault: Annotated[
        list[str] | None, Option(help="What is wrong with them, KIND[:key=value,...]; repeatable.")
    ] = None,
    flash_s: Annotated[float, Option(min=0, max=60, help="How long a save takes, s.")] = 0.35,
    seconds: Annotated[float | None, Option(min=0, help="Stop after this time; left out: at Ctrl-C.")] = None,
) -> int:
    """Put simulated devices on a CAN interface: real CANopen slaves, to try a station or another program on.

    A device until Ctrl-C, on CAN frames by multicast; with --channel vcan0 alone, on that CAN interface. `station run`
    in another window, with the same bus in its config.yaml, calibrates it:

        station device --interface udp_multicast --channel 239.74.163.2 --node 0x11 --serial SN0042

    Lines on standard input turn the world they feel: `up +x`, `true 0 0 -1`, `temperature 31`. The first line of
    standard output tells their true errors as JSON, once they are on the bus.
    """
    from station.cli._device import parse_node_id, serve_devices
    from station.wiring.live_device import Population

    wanted = Population(
        product=product,
        channel=channel,
        interface=interface,
        nodes=tuple(map(parse_node_id, node)),
        serials=tuple(serial),
        rate_hz=rate_hz,
        seed=seed,
        memory=memory,
        faults=tuple(fault or ()),
        flash_s=flash_s,
    )
    return serve_devices(wanted, seconds)
