"""The options of `station rig`: what each one says of itself."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

Action = Annotated[
    str, Argument(help="check: commission the drives of config.yaml. axes: the axes' own errors, from the log.")
]
Simulate = Annotated[
    str | None,
    Option(
        help="What to simulate: cia402 (drives), grbl, plc (with its cell), io (remote I/O with its cell), light, "
        "scanner or printer."
    ),
]
Channel = Annotated[str, Option(help="cia402: the CAN interface.")]
Interface = Annotated[str, Option(help="cia402: the kind of bus that --channel is on.")]
Host = Annotated[str, Option(help="Address to listen at.")]
Port = Annotated[int, Option(min=0, max=65535, help="Port to listen at; 0: any, printed first.")]
Map = Annotated[
    str | None,
    Option(help="plc: its registers, a file or a name in cells/. cia402, grbl, axes: the rig, likewise in rigs/."),
]
Nests = Annotated[int, Option(min=1, max=16, help="plc, io: nests of the fixture.")]
Loads = Annotated[int | None, Option(min=0, help="plc, io: so many loads come; left out: without end.")]
Change = Annotated[float, Option(min=0, help="plc, io: how long units are changed for.")]
ScannerPort = Annotated[
    int | None, Option(min=0, max=65535, help="plc, io: a scanner of the cell's labels listens here too.")
]
Memory = Annotated[str | None, Option(help="plc: file of its retentive memory, which outlives the process.")]
Label = Annotated[list[str] | None, Option(help="scanner: NEST=TEXT that it reads; repeatable.")]
Fault = Annotated[
    list[str] | None,
    Option(
        help="What is wrong with it; repeatable. plc: KIND[:at=3,after_s=0.2,seconds=5]; "
        "cia402: KIND[:axis=0,after_s=0.3,move=1]; grbl, io, printer: KIND."
    ),
]
Seconds = Annotated[float | None, Option(min=0, help="Stop after this time; left out: at Ctrl-C.")]
Config = Annotated[Path | None, Option(help="check, axes: station settings; left out: ./config.yaml.")]
Recipe = Annotated[str | None, Option(help="check: a recipe of the units in the nests, by name or path.")]
Bench = Annotated[bool, Option("--bench", help="check: the simulated rig and units, nothing real.")]
Mounted = Annotated[str | None, Option(help="check --bench: a map of how the rig is really built.")]
Speed = Annotated[float, Option(min=0.5, max=90, help="check: speed of the moves, deg/s.")]
Database = Annotated[Path | None, Option(help="axes: the log; left out: as config.yaml says.")]
Since = Annotated[str | None, Option(help="axes: only units from then on, 2026-11-21 or 7d.")]
Units = Annotated[int, Option(min=1, max=1000, help="axes: the newest so many attempts.")]
Correct = Annotated[Path | None, Option(help="check, axes: write the map as it should be into this file.")]
AsJson = Annotated[bool, Option("--json", help="check, axes: one JSON document on standard output.")]
