"""`station rig`: simulated machines around the station, each a process of its own."""

from typing import Annotated

from typer import Option


def command(
    simulate: Annotated[str, Option(help="What to simulate: plc (with its cell), scanner or printer.")],
    host: Annotated[str, Option(help="Address to listen at.")] = "127.0.0.1",
    port: Annotated[int, Option(min=0, max=65535, help="Port to listen at; 0: any, printed first.")] = 0,
    map: Annotated[str, Option(help="plc: its registers, a file or a name in cells/.")] = "cell",  # noqa: A002
    nests: Annotated[int, Option(min=1, max=16, help="plc: nests of the fixture.")] = 4,
    loads: Annotated[int | None, Option(min=0, help="plc: so many loads come; left out: without end.")] = None,
    change_s: Annotated[float, Option(min=0, help="plc: how long units are changed for.")] = 1.0,
    scanner_port: Annotated[
        int | None, Option(min=0, max=65535, help="plc: a scanner of the cell's labels listens here too.")
    ] = None,
    memory: Annotated[str | None, Option(help="plc: file of its retentive memory, which outlives the process.")] = None,
    label: Annotated[list[str] | None, Option(help="scanner: NEST=TEXT that it reads; repeatable.")] = None,
    fault: Annotated[
        list[str] | None, Option(help="plc: what is wrong with it, KIND[:at=3,after_s=0.2,seconds=5]; repeatable.")
    ] = None,
    seconds: Annotated[float | None, Option(min=0, help="Stop after this time; left out: at Ctrl-C.")] = None,
) -> int:
    """Simulate a machine that stands around the station, to try a line on it before there is one.

    A PLC with its cell and a scanner of its labels; each line of standard output says what happened there as JSON:

        station rig --simulate plc --port 5020 --scanner-port 9004 --loads 10

    The same with the door opened in the third move, for 2 s:

        station rig --simulate plc --port 5020 --fault door-opened:at=3,seconds=2
    """
    from station.cli._rig import Machine, simulate_machine

    machine = Machine(
        host=host,
        port=port,
        plc_map=map,
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
