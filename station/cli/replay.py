"""`station replay`: a recorded CAN log through the pipeline of a run."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from station.cli._options import AsJson

#: Options that only go with one of these words.
GOES_WITH = {"--out": ("--dbc",)}
#: Options that none of these words may stand beside.
APART = {"--recipe": ("--dbc",), "--marks": ("--dbc",)}


def command(
    log: Annotated[Path, Argument(help="CAN log: .log (candump), .blf, .asc or .mf4.")],
    recipe: Annotated[str | None, Option(help="Recipe; left out: the one that the marks name.")] = None,
    marks: Annotated[Path | None, Option(help="Marks; left out: LOG.marks.json or .csv beside the log.")] = None,
    dbc: Annotated[Path | None, Option(help="Only decode: a DBC, in place of a recipe.")] = None,
    out: Annotated[Path | None, Option(help="With --dbc: every decoded signal as a CSV table.")] = None,
    json: AsJson = False,
) -> int:
    """Take a recorded CAN log through the pipeline of a run; no device is written.

    With the marks that `station export` puts beside a log, or that a person wrote:

        station replay SN0042.log --recipe six-point

    Without marks, stills that show every position of the recipe are found by themselves. To see what any log
    holds, frame for frame:

        station replay drive.blf --dbc dbc/accelerometer.dbc
    """
    from station.cli._replay import decode_log, replay_log

    if dbc is not None:
        return decode_log(log, dbc, out, as_json=json)
    return replay_log(log, recipe, marks, as_json=json)
