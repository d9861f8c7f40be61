"""`station schema`: JSON schemas of the files that people write, for editors."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option


def command(
    kind: Annotated[str | None, Argument(help="recipe, product or config; left out: all, with --out.")] = None,
    out: Annotated[Path | None, Option(help="Folder to write KIND.json into; left out: standard output.")] = None,
) -> int:
    """Print the JSON schema of a recipe, a product or config.yaml: an editor completes keys and marks mistakes by it.

    One of them, to look at:

        station schema recipe

    All of them into the folder that the shipped files name in their first line:

        station schema --out schemas

    An editor with a YAML language server reads `# yaml-language-server: $schema=../schemas/recipe.json` at the top.
    """
    from station.cli._schema import print_or_write

    return print_or_write(kind, out)
