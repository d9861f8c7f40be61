"""`station rig`: commissioning of a rig of drives, and simulated machines around the station."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option


def command(
    action: Annotated[str, Argument(help="check: commission the drives of config.yaml.")] = "",
    simulate: Annotated[
        str | None, Option(help="What to simulate: cia402 (drives), plc (with its cell), scanner or printer.")
    ] = None,
    channel: Annotated[str, Option(help="cia402: the CAN interface.")] = "vcan1",
    host: Annotated[str, Option(help="Address to listen at.")] = "127.0.0.1",
    port: Annotated[int, Option(min=0, max=65535, help="Port to listen at; 0: any, printed first.")] = 0,
    map: Annotated[  # noqa: A002
        str | None, Option(help="plc: its registers, a file or a name in cells/. cia402: the rig, likewise in rigs/.")
    ] = None,
    nests: Annotated[int, Option(min=1, max=16, help="plc: nests of the fixture.")] = 4,
    loads: Annotated[int | None, Option(min=0, help="plc: so many loads come; left out: without end.")] = None,
    change_s: Annotated[float, Option(min=0, help="plc: how long units are changed for.")] = 1.0,
    scanner_port: Annotated[
        int | None, Option(min=0, max=65535, help="plc: a scanner of the cell's labels listens here too.")
    ] = None,
    memory: Annotated[str | None, Option(help="plc: file of its retentive memory, which outlives the process.")] = None,
    label: Annotated[list[str] | None, Option(help="scanner: NEST=TEXT that it reads; repeatable.")] = None,
    fault: Annotated[
        list[str] | None,
        Option(
            help="What is wrong with it; repeatable. plc: KIND[:at=3,after_s=0.2,seconds=5]; "
            "cia402: KIND[:axis=0,after_s=0.3,move=1]."
        ),
    ] = None,
    seconds: Annotated[float | None, Option(min=0, help="Stop after this time; left out: at Ctrl-C.")] = None,
    config: Annotated[Path | None, Option(help="check: station settings; left out: ./config.yaml.")] = None,
    recipe: Annotated[str | None, Option(help="check: a recipe of the units in the nests, by name or path.")] = None,
    bench: Annotated[bool, Option("--bench", help="check: the simulated rig and units, nothing real.")] = False,
    mounted: Annotated[str | None, Option(help="check --bench: a map of how the rig is really built.")] = None,
    speed: Annotated[float, Option(min=0.5, max=90, help="check: speed of the moves, deg/s.")] = 15.0,
    correct: Annotated[Path | None, Option(help="check: write the map as it should be into this file.")] = None,
    json_: Annotated[bool, Option("--json", help="check: one JSON document on standard output.")] = False,
) -> int:
    """Commission a rig of drives, or simulate a machine that stands around the station.

    With units in the nests, nobody near the rig and a hand on the emergency stop: moves each axis a little, then slowly
    all around, and compares the encoders with the gravity that the units feel. Finds swapped axes, signs, gear ratios
    and zeros:

        station rig check --config config.yaml --correct corrected.yaml

    The same without anything real:

        station rig check --bench

    Two simulated drives on vcan1 until Ctrl-C, for `positioner: {kind: cia402, channel: vcan1}`:

        station rig --simulate cia402 --channel vcan1

    A PLC with its cell and a scanner of its labels; each line of standard output says what happened there as JSON:

        station rig --simulate plc --port 5020 --scanner-port 9004 --loads 10

    The same with the door opened in the third move, for 2 s:

        station rig --simulate plc --port 5020 --fault door-opened:at=3,seconds=2
    """
    from station.cli import _rig_drives
    from station.errors import UsageError

    if action == "check":
        return _rig_drives.check(_rig_drives.CheckRequest(config, recipe, bench, mounted, speed, correct, json_))
    if action or simulate is None:
        raise UsageError("rig-action", action=action)
    if simulate == _rig_drives.DRIVES:
        return _rig_drives.serve_drives(map or "two-axis", channel, tuple(fault or ()), seconds)
    from station.cli._rig import Machine, simulate_machine

    machine = Machine(
        host=host,
        port=port,
        plc_map=map or Machine().plc_map,
        nests=nests,
        loads=loads,
        change_s=change_s,
        scanner_port=scanner_port,
        memory=memory,
        labels=tuple(label or ()),
        faults=tuple(fault or ()),
        seconds=seconds,
    )
    return simulate_machine(simulate, machine)
