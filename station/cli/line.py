"""`station line`: the station for a shift."""

from pathlib import Path
from typing import Annotated, Literal

from typer import Option

from station.cli._options import ConfigPath, LogPath

_OF_A_SHIFT = ("--recipe", "--simulate", "--loads", "--fault", "--device-state", "--seed", "--operator", "--lot")
#: Options that none of these words may stand beside.
APART = dict.fromkeys((*_OF_A_SHIFT, "--clear", "--json"), ("--send", "--serve")) | {"--serve": ("--send",)}


def command(
    recipe: Annotated[str | None, Option(help="Recipe: a file, or its name in recipes/.")] = None,
    config: ConfigPath = None,
    simulate: Annotated[
        bool, Option("--simulate", help="Simulated bus, rig and units; without a line: block, a simulated cell too.")
    ] = False,
    loads: Annotated[int | None, Option(min=1, help="Complete after so many loads; left out: until stopped.")] = None,
    db: LogPath = None,
    fault: Annotated[
        list[str] | None, Option(help="With --simulate: what is wrong with the simulated cell's PLC; repeatable.")
    ] = None,
    device_state: Annotated[
        Path | None, Option(help="With --simulate: folder of the devices' non-volatile memory.")
    ] = None,
    seed: Annotated[int, Option(help="With --simulate: seed of everything random.")] = 1,
    operator: Annotated[str | None, Option(help="Who runs it, for the record.")] = None,
    lot: Annotated[str | None, Option(help="Lot of the units, for the record.")] = None,
    clear: Annotated[bool, Option("--clear", help="After a crash: the cell was looked at, go on.")] = False,
    send: Annotated[
        str | None,
        Option(help="Give the running line a PackML command (hold, unhold, stop, clear, ...) and end."),
    ] = None,
    serve: Annotated[
        Literal["opcua", "modbus"] | None, Option(help="Serve the state of the running line, as config.yaml says.")
    ] = None,
    json: Annotated[bool, Option("--json", help="One JSON document on standard output at the end.")] = False,
) -> int:
    """Run for a shift: wait for a load, read its labels, calibrate, hand it back, wait for the next.

    Two loads through a simulated cell, with nothing plugged in:

        station line --simulate --loads 2

    On a line, as `line:` in config.yaml describes it; its state for the line controller in processes of their own:

        station line --recipe six-point
        station line --serve opcua
        station line --serve modbus
    """
    from station.cli._line import LineRequest, command_line, run_line, serve_line
    from station.wiring.run_order import RunOrder

    order = RunOrder(
        recipe=recipe,
        config=config,
        database=db,
        simulate=simulate,
        seed=seed,
        device_state=device_state,
        operator=operator,
        lot=lot,
    )
    if send is not None:
        return command_line(order, send)
    if serve is not None:
        return serve_line(order, serve)
    return run_line(order, LineRequest(loads=loads, faults=tuple(fault or ()), clear=clear, as_json=json))
