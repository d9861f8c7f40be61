"""`station msa`: measurement-system studies."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from station.cli._options import AsJson, ConfigPath, LogPath

#: Options that only go with one of these words.
GOES_WITH = {
    "--repeats": ("type1", "bias"), "--reference": ("type1", "bias"), "--tolerance": ("type1", "grr"),
    "--trials": ("grr",), "--nests": ("grr",), "--k-percent": ("type1",), "--spread": ("type1",),
    "--resolution": ("type1",), "--seed": ("--simulate",),
}  # fmt: skip
#: Options that none of these words may stand beside: a table has its readings already.
APART = dict.fromkeys(("--serial", "--repeats", "--trials", "--nests", "--simulate"), ("--samples",)) | {
    "--run": ("--samples", "--simulate")
}


def command(
    study: Annotated[str, Argument(help="type1, grr, bias or linearity.")],
    value: Annotated[str, Option(help="What is studied: 'offset x', 'gain z', 'residual rms', …")] = "offset x",
    serial: Annotated[list[str] | None, Option(help="The unit, or with grr each part; repeatable.")] = None,
    repeats: Annotated[int, Option(min=2, max=1000, help="type1, bias: readings.")] = 25,
    trials: Annotated[int, Option(min=2, max=20, help="grr: readings of each part in each nest.")] = 3,
    nests: Annotated[int, Option(min=2, max=127, help="grr: how many nests (they are the appraisers).")] = 3,
    reference: Annotated[float | None, Option(help="type1, bias: the unit's known value.")] = None,
    tolerance: Annotated[float | None, Option(help="Full width T; left out: from the recipe's limits.")] = None,
    k_percent: Annotated[float, Option(min=1, max=100, help="type1: share of T, percent.")] = 20,
    spread: Annotated[float, Option(min=1, max=10, help="type1: width of the spread in s (6; some firms take 4).")] = 6,
    resolution: Annotated[float, Option(min=0, help="type1: smallest step of the value.")] = 0,
    samples: Annotated[
        Path | None, Option(help="CSV: value (type1, bias), part,appraiser,trial,value (grr) or reference,value.")
    ] = None,
    simulate: Annotated[bool, Option("--simulate", help="Make the missing readings on the simulated station.")] = False,
    run: Annotated[bool, Option("--run", help="Make the missing readings on this station, step by step.")] = False,
    recipe: Annotated[str | None, Option(help="Recipe of the readings.")] = None,
    config: ConfigPath = None,
    db: LogPath = None,
    seed: Annotated[int, Option(help="With --simulate: seed of everything random.")] = 1,
    json: AsJson = False,
) -> int:
    """Study the measurement system: type-1 (Cg, Cgk), gauge R&R (ANOVA and X̄-R), bias, linearity (AIAG MSA-4).

    Readings come from the log; those that are missing are made with --run or --simulate, load by load, and a study
    that was broken off goes on where it stopped. What came out is kept beside the log.

        station msa type1 --serial SN0001 --repeats 25 --reference 0.0219 --simulate --db msa.db

    Three parts, two nests, two trials (a study proper: ten parts, three nests, three trials):

        station msa grr --serial SN0001 --serial SN0002 --serial SN0003 --trials 2 --nests 2 --simulate --db grr.db

    Readings from elsewhere:

        station msa grr --samples readings.csv --tolerance 0.2

    Bias against a known value; linearity over golden units with certified values, or a table with reference,value:

        station msa bias --serial SN0001 --repeats 5 --reference 0.0219 --simulate --db msa.db
        station msa linearity --samples linearity.csv
    """
    from station.cli._msa import MsaRequest, run_study
    from station.wiring.run_order import RunOrder

    order = RunOrder(recipe=recipe, config=config, database=db, simulate=simulate, seed=seed)
    request = MsaRequest(
        study=study,
        value=value,
        serials=tuple(serial or ()),
        repeats=repeats,
        trials=trials,
        nests=nests,
        reference=reference,
        tolerance=tolerance,
        k_percent=k_percent,
        spread=spread,
        resolution=resolution,
        samples=samples,
        measures_missing=run or simulate,
    )
    return run_study(order, request, as_json=json)
