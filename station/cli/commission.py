"""`station commission`: node ids for the fresh devices of a fixture."""

from pathlib import Path
from typing import Annotated

from typer import Option

from station.cli._options import ConfigPath


def command(
    serial: Annotated[list[str] | None, Option(help="Scanned label of a unit; one per --nest, repeatable.")] = None,
    nest: Annotated[list[str] | None, Option(help="The nest that this unit is in, as config.yaml names it.")] = None,
    config: ConfigPath = None,
    recipe: Annotated[
        str | None, Option(help="A recipe of the units, by name or path; left out: as config.yaml.")
    ] = None,
    simulate: Annotated[bool, Option("--simulate", help="Fresh simulated devices, nothing real.")] = False,
    device_state: Annotated[
        Path | None, Option(help="--simulate: folder where the devices keep their node ids; left out: fresh each time.")
    ] = None,
    bit_rate: Annotated[
        int | None, Option(help="kbit/s that each device keeps too, from its next power-on; by CiA 305's table.")
    ] = None,
    prove_nests: Annotated[
        bool, Option("--prove-nests", help="Find the nest of each unlabelled unit: you take them out one by one.")
    ] = False,
    json_: Annotated[bool, Option("--json", help="One JSON document on standard output.")] = False,
) -> int:
    """Give the devices of a fixture their node ids by LSS (CiA 305), though they all have the same or none.

    Units with scanned labels get the id of their nest; the others are found one at a time by a fast scan and get the
    ids that are left, in the order of the nests. Each id is stored and proven by a read of 0x1018. Killed at any
    moment, it leaves no two devices with one id, and the same command goes on.

    On fresh simulated devices; without --simulate on those of the bench:

        station commission --simulate --serial SN0042 --nest A --serial SN0043 --nest B

    Nobody has scanned anything:

        station commission --simulate --json

    Nor is it known which unit is in which nest: take each out when you are asked to:

        station commission --simulate --prove-nests
    """
    from station.cli._commission import commission_and_print
    from station.wiring.commission import CommissionOrder

    pairs = tuple(serial or ()), tuple(nest or ())
    order = CommissionOrder(config, recipe, simulate, *pairs, device_state, bit_rate, prove_nests)
    return commission_and_print(order, json=json_)
