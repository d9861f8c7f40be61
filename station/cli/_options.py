"""Options that most commands share, each with its one help text."""

from pathlib import Path
from typing import Annotated

from typer import Option

ConfigPath = Annotated[Path | None, Option(help="Station settings; left out: ./config.yaml.")]
LogPath = Annotated[Path | None, Option(help="The log; left out: as config.yaml says.")]
AsJson = Annotated[bool, Option("--json", help="One JSON document on standard output.")]
