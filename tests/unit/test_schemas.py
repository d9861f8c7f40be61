"""Schemas for editors are those of the code; every shipped file names its own; completion knows every command."""

import json
import re
import subprocess
from pathlib import Path

import pytest

from station.cli._completion import script
from station.cli._schema import KINDS, schema_text
from station.cli.app import commands
from station.errors import UsageError

ROOT = Path(__file__).parents[2]
FILES = [*(ROOT / "recipes").rglob("*.yaml"), *(ROOT / "dbc").rglob("*.yaml"), ROOT / "config.yaml"]


@pytest.mark.parametrize("kind", KINDS)
def test_the_shipped_schema_is_the_codes(kind: str) -> None:
    assert (ROOT / "schemas" / f"{kind}.json").read_text("utf-8") == schema_text(kind), (
        "run `station schema --out schemas`"
    )
    assert json.loads(schema_text(kind))["additionalProperties"] is False


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_every_shipped_file_names_its_schema(path: Path) -> None:
    named = re.match(r"# yaml-language-server: \$schema=(\S+)\n", path.read_text("utf-8"))
    assert named is not None
    assert (path.parent / named[1]).resolve().parent == ROOT / "schemas"
    assert (path.parent / named[1]).is_file()


def test_bash_completes_commands_and_options(tmp_path: Path) -> None:
    (tmp_path / "c.bash").write_text(script("bash"))
    ask = 'source c.bash; COMP_WORDS=(station {}); COMP_CWORD={}; _station; echo "${{COMPREPLY[@]}}"'
    for words, place, wanted in (
        ("ce", 1, "certificate"),
        ("run --si", 2, "--simulate"),
        ("audit --ver", 2, "--verify"),
    ):
        done = subprocess.run(
            ["bash", "-c", ask.format(words, place)], capture_output=True, text=True, check=True, cwd=tmp_path
        )
        assert wanted in done.stdout.split()


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_every_command_is_in_the_script(shell: str) -> None:
    text = script(shell)
    assert [name for name in commands() if not re.search(rf"(:| ){name}[ )]", text)] == []


def test_another_shell_is_refused() -> None:
    with pytest.raises(UsageError, match="no completion for 'csh'"):
        script("csh")
