"""The options of `station run`: what each one says of itself."""

from pathlib import Path
from typing import Annotated

from typer import Option

Recipe = Annotated[str | None, Option(help="Recipe: a file, or its name in recipes/.")]
Config = Annotated[Path | None, Option(help="Station settings; left out: ./config.yaml.")]
Simulate = Annotated[bool, Option("--simulate", help="Virtual bus, simulated rig and devices.")]
Units = Annotated[int | None, Option(min=1, max=100_000, help="How many units.")]
Serials = Annotated[list[str] | None, Option(help="Serial of a unit; repeatable, one per nest.")]
Nests = Annotated[list[str] | None, Option(help="Nest of each --serial, in its order; left out: one by one.")]
Database = Annotated[Path | None, Option(help="The log; left out: as config.yaml says.")]
Effects = Annotated[list[str] | None, Option(help="With --simulate: switch on a cause, ID or ID=SIZE.")]
Faults = Annotated[list[str] | None, Option(help="With --simulate: what is wrong with a device, KIND[:key=value,...].")]
Seed = Annotated[int, Option(help="With --simulate: seed of everything random.")]
Model = Annotated[
    Path | None,
    Option(help="Model of `diagnose --extend`: the calibration takes in what is the device's own; simulated too."),
]
DeviceState = Annotated[Path | None, Option(help="With --simulate: folder of the devices' non-volatile memory.")]
Mounted = Annotated[str | None, Option(help="With --simulate and drives: a map of how the rig is really built.")]
Pace = Annotated[
    float | None, Option(min=0.01, help="With --simulate: so many times real time, to watch it; left out: at once.")
]
Interface = Annotated[str | None, Option(help="Bus interface, in place of config.yaml's.")]
Channel = Annotated[str | None, Option(help="Bus channel, in place of config.yaml's.")]
Operator = Annotated[str | None, Option(help="Who runs it, for the record.")]
Lot = Annotated[str | None, Option(help="Lot of the units, for the record.")]
AskAtPage = Annotated[
    bool, Option("--ask-at-page", help="What a person has to do is confirmed at `station panel`, not here.")
]
AsJson = Annotated[bool, Option("--json", help="One JSON document on standard output.")]
