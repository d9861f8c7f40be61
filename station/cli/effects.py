"""`station effects`: the causes that the simulation knows."""

from typing import Annotated

from typer import Option


def command(
    json: Annotated[bool, Option("--json", help="One JSON document on standard output.")] = False,
    markdown: Annotated[bool, Option("--markdown", help="The page docs/effects.md.")] = False,
) -> int:
    """List the causes that the simulation can switch on and a diagnosis can name.

    Each with what it is, its parameter and its typical size:

        station effects
    """
    from station.cli import _output as _face
    from station.model import catalogue

    if markdown:
        _face.print_line(catalogue.page().rstrip("\n"))
        return 0
    rows = catalogue.rows()
    if json:
        _face.print_json({"schema": "station.effects/1", "effects": rows})
        return 0
    width = max(len(row["effect"]) for row in rows)
    for row in rows:
        first = row["parameters"][0]
        size = first["typical"] if isinstance(first["typical"], str) else f"{first['typical']:g} {first['unit']}"
        _face.print_line(f"{row['effect']:<{width}}  {size:<14}  {row['physics']}")
    return 0
