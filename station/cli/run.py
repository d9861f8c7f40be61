"""`station run`: the main job."""

from pathlib import Path
from typing import Annotated

from typer import Option


def command(
    recipe: Annotated[str | None, Option(help="Recipe: a file, or its name in recipes/.")] = None,
    config: Annotated[Path | None, Option(help="Station settings; left out: ./config.yaml.")] = None,
    simulate: Annotated[bool, Option("--simulate", help="Virtual bus, simulated rig and devices.")] = False,
    units: Annotated[int | None, Option(min=1, max=100_000, help="How many units.")] = None,
    serial: Annotated[list[str] | None, Option(help="Serial of a unit; repeatable, one per nest.")] = None,
    nest: Annotated[list[str] | None, Option(help="Nest of each --serial, in its order; left out: one by one.")] = None,
    db: Annotated[Path | None, Option(help="The log; left out: as config.yaml says.")] = None,
    effect: Annotated[list[str] | None, Option(help="With --simulate: switch on a cause, ID or ID=SIZE.")] = None,
    fault: Annotated[
        list[str] | None, Option(help="With --simulate: what is wrong with a device, KIND[:key=value,...].")
    ] = None,
    seed: Annotated[int, Option(help="With --simulate: seed of everything random.")] = 1,
    model: Annotated[
        Path | None,
        Option(help="Model of `diagnose --extend`: the calibration takes in what is the device's own; simulated too."),
    ] = None,
    device_state: Annotated[
        Path | None, Option(help="With --simulate: folder of the devices' non-volatile memory.")
    ] = None,
    pace: Annotated[
        float | None, Option(min=0.01, help="With --simulate: so many times real time, to watch it; left out: at once.")
    ] = None,
    interface: Annotated[str | None, Option(help="Bus interface, in place of config.yaml's.")] = None,
    channel: Annotated[str | None, Option(help="Bus channel, in place of config.yaml's.")] = None,
    operator: Annotated[str | None, Option(help="Who runs it, for the record.")] = None,
    lot: Annotated[str | None, Option(help="Lot of the units, for the record.")] = None,
    ask_at_page: Annotated[
        bool, Option("--ask-at-page", help="What a person has to do is confirmed at `station panel`, not here.")
    ] = False,
    json: Annotated[bool, Option("--json", help="One JSON document on standard output.")] = False,
) -> int:
    """Take units through the recipe: calibrate, judge, write back, verify, log.

    On a virtual bus, without any hardware:

        station run --simulate --units 4

    On a bench, serials from the command line, a scanner on standard input, or a prompt:

        station run --recipe six-point --serial SN0042 --serial SN0043
    """
    from station.cli._run import RunOptions, run_units
    from station.errors import UsageError
    from station.wiring.rehearsal import rehearsing
    from station.wiring.run_order import RunOrder

    order = RunOrder(
        recipe=recipe,
        config=config,
        database=db,
        simulate=simulate,
        seed=seed,
        effects=tuple(effect or ()),
        faults=tuple(fault or ()),
        model=model,
        device_state=device_state,
        interface=interface,
        channel=channel,
        operator=operator,
        lot=lot,
    )
    if pace is not None and not simulate and not rehearsing(config):
        raise UsageError("option-needs-simulate", option="--pace")
    face = RunOptions(as_json=json, pace=pace, nests=tuple(nest or ()), confirm_at_page=ask_at_page)
    return run_units(order, tuple(serial or ()), units, face)
