"""`station simulate`: the forward simulation."""

from pathlib import Path
from typing import Annotated

from typer import Option

from station.cli._options import AsJson


def command(
    out: Annotated[Path, Option(help="What to write: samples (.parquet, .csv) or CAN frames (.log, .blf).")],
    recipe: Annotated[str | None, Option(help="Recipe: a file, or its name in recipes/.")] = None,
    units: Annotated[int, Option(min=1, max=100_000, help="How many units.")] = 4,
    seed: Annotated[int, Option(min=0, help="Seed of everything random.")] = 1,
    model: Annotated[Path | None, Option(help="Model file, as `station diagnose --extend` writes it.")] = None,
    effect: Annotated[list[str] | None, Option(help="Switch on a cause, ID or ID=SIZE; repeatable.")] = None,
    product: Annotated[str | None, Option(help="For frames: the product, where the recipe names none.")] = None,
    nests: Annotated[int, Option(min=1, max=127, help="Nests of the fixture; units go on by one each run.")] = 2,
    operators: Annotated[int, Option(min=1, max=1000, help="Operators that take turns.")] = 2,
    lots: Annotated[int, Option(min=1, max=1000, help="Lots that the units are from.")] = 2,
    gold: Annotated[bool, Option("--gold", help="Also read a gold reference in each nest.")] = False,
    json: AsJson = False,
) -> int:
    """Simulate a campaign: device, rig, room and bus, sample by sample, with any of the known causes.

    The truth about it is written beside it, as OUT.truth.json; `station effects` lists the causes.

        station simulate --recipe tilt-24 --units 4 --effect nest-tilt --effect quadratic=0.001 --out samples.parquet

    As a log of the bus, with the marks that `station replay` needs:

        station simulate --recipe six-point --units 4 --effect lost-frames=0.02 --out frames.log
    """
    from station.cli._simulate import SimulateRequest, run_simulate
    from station.model.simulated_line import SimulatedLine

    request = SimulateRequest(
        recipe=recipe,
        units=units,
        seed=seed,
        model=model,
        effects=tuple(effect or ()),
        product=product,
        line=SimulatedLine(nests=nests, operators=operators, lots=lots),
        gold=gold,
    )
    return run_simulate(out, request, as_json=json)
