"""`station effects`: the causes that the simulation knows."""

from pathlib import Path
from typing import Annotated

from typer import Option

from station.cli._options import AsJson

#: Options that only go with one of these words.
GOES_WITH = {
    "--model": ("--write-hypothesis",),
    "--formula": ("--write-hypothesis",),
    "--into": ("--write-hypothesis",),
}

#: Options that none of these words may stand beside.
APART = {"--json": ("--markdown", "--write-hypothesis"), "--markdown": ("--write-hypothesis",)}


def command(
    json: AsJson = False,
    markdown: Annotated[bool, Option("--markdown", help="The page docs/effects.md.")] = False,
    write_hypothesis: Annotated[
        str | None, Option("--write-hypothesis", help="Adopt a formula of --model as an effect of this name.")
    ] = None,
    model: Annotated[
        list[Path] | None,
        Option(help="With --write-hypothesis: the file that holds the formula; repeat it to pool several campaigns."),
    ] = None,
    formula: Annotated[str, Option(help="Which of several formulas of the model, for example formula-2.")] = "",
    into: Annotated[Path | None, Option(help="Folder of the effect file; left out: the station's own.")] = None,
) -> int:
    """List the causes that the simulation can switch on and a diagnosis can name.

    Each with what it is, its parameter and its typical size:

        station effects

    A formula that `diagnose --extend model.yaml` proposed becomes an effect file, to be completed by a person:

        station effects --write-hypothesis thermal-square --model hypothesis.yaml --into effects

    Give --model once for each station that found it: their sizes are pooled, and a size on which they disagree becomes
    one of each station.
    """
    from station.cli import _output as _face
    from station.cli._layout import TextTable
    from station.model import catalogue

    if write_hypothesis is not None:
        from station.cli._write_hypothesis import write_hypothesis as write

        return write(write_hypothesis, model or [], formula, into)
    if markdown:
        _face.print_raw(catalogue.page().rstrip("\n"))
        return 0
    rows = catalogue.rows()
    if json:
        _face.print_json({"schema": "station.effects/1", "effects": rows})
        return 0
    shown = []
    for row in rows:
        first = row["parameters"][0]
        unit = "" if first["unit"] == "1" else f" {first['unit']}"
        size = first["typical"] if isinstance(first["typical"], str) else f"{first['typical']:g}{unit}"
        shown.append((row["effect"], size, row["physics"]))
    _face.print_table("", TextTable(("cause", "typical size", "what it is"), shown, words=frozenset({2})))
    return 0
