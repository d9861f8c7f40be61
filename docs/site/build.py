"""Builds the documentation site: `python docs/site/build.py OUT`. Static pages with a search, dead links refused.

The pages of docs/ stay as they are; reference pages are made from the code: commands from their helps, files from their
schemas. Pages and links are checked by Sphinx (-W -n): a dead one ends the build.
"""

import io
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from sphinx.cmd.build import main as sphinx_build

from station.cli._schema import KINDS, schema_text
from station.cli.app import commands, run_command

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
#: Title of a group in the navigation → its pages.
GROUPS: Mapping[str, tuple[str, ...]] = {
    "Tutorials": ("tutorials/bench-in-15-minutes", "tutorials/new-product", "tutorials/first-diagnosis"),
    "How to": (
        "good-calibration", "import", "bench", "rig", "recipes", "device-map", "frames", "panel", "line", "plant",
        "reading-the-report", "simulated-device",
    ),
    "Explanation": ("diagnosis", "uncertainty", "effects", "architecture", "promises", "threats", "decisions/index"),
    "Reference": (
        "reference/commands", "reference/recipe", "reference/product", "reference/config", "formats", "log-format",
        "faults", "glossary", "benchmarks", "diagnosis-numbers", "contributing", "security", "changelog",
    ),
}  # fmt: skip
#: Files of the repository that are pages, too.
BESIDE = {"CONTRIBUTING.md": "contributing", "SECURITY.md": "security", "CHANGELOG.md": "changelog"}


def main() -> int:
    """See the top of the file; Sphinx' exit code."""
    out = Path(sys.argv[1])
    with tempfile.TemporaryDirectory() as name:
        source = Path(name)
        assemble(source)
        return sphinx_build(["-q", "-W", "--keep-going", "-c", str(Path(__file__).parent), str(source), str(out)])


def assemble(source: Path) -> None:
    """Pages, pictures and generated reference, as one folder for Sphinx."""
    shutil.copytree(DOCS, source, dirs_exist_ok=True, ignore=shutil.ignore_patterns("*.py", "site", "__pycache__"))
    for file, page in BESIDE.items():
        shutil.copy(ROOT / file, source / f"{page}.md")
    (source / "README.md").unlink()
    (source / "reference").mkdir()
    (source / "reference" / "commands.md").write_text(_commands_page(), encoding="utf-8")
    for kind in KINDS:
        (source / "reference" / f"{kind}.md").write_text(_schema_page(kind), encoding="utf-8")
    _write_index(source)
    for path in source.rglob("*.md"):
        path.write_text(_relinked(path.read_text(encoding="utf-8"), path.relative_to(source)), encoding="utf-8")


def _write_index(source: Path) -> None:
    decisions = sorted((source / "decisions").glob("[0-9]*.md"))
    listed = "\n".join(p.stem for p in decisions)
    (source / "decisions" / "index.md").write_text(f"# Decisions\n\n```{{toctree}}\n{listed}\n```\n", encoding="utf-8")
    known = {page for pages in GROUPS.values() for page in pages}
    others = sorted(p.stem for p in source.glob("*.md") if p.stem not in known and p.stem != "index")
    groups = {title: list(pages) for title, pages in GROUPS.items()}
    groups["Reference"] += others
    text = (ROOT / "README.md").read_text(encoding="utf-8").partition("\n## ")[0]
    text = re.sub(r"^!\[.*$", "", text, flags=re.MULTILINE)
    trees = (
        f"```{{toctree}}\n:caption: {title}\n:hidden:\n{chr(10).join(pages)}\n```" for title, pages in groups.items()
    )
    lists = (f"**{title}**\n\n" + "\n".join(f"* [](/{p}.md)" for p in pages) for title, pages in GROUPS.items())
    (source / "index.md").write_text("\n\n".join([text, *lists, *trees]) + "\n", encoding="utf-8")


def _relinked(text: str, path: Path) -> str:
    """Links to files of the repository that are pages here; other files outside docs/ are named, not linked."""
    up = "../" * (len(path.parts) - 1)

    def one(found: re.Match[str]) -> str:
        target = found[2].rpartition("/")[2].partition("#")[0]
        if target in BESIDE:
            return f"[{found[1]}]({up}{BESIDE[target]}.md)"
        if found[2].startswith(("../", "docs/")) and not (DOCS / path.parent / found[2].partition("#")[0]).exists():
            return found[1]
        outside = found[2].startswith("../") and DOCS not in (DOCS / path.parent / found[2]).resolve().parents
        return f"`{found[1].strip('`')}`" if outside else found[0]

    text = re.sub(r"\[([^\]]*)\]\((?!https?:|/)([^)\s]+)\)", one, text)
    return re.sub(r"^```mermaid$", "```text", text, flags=re.MULTILINE)


def _commands_page() -> str:
    """Every command with its help, as a terminal shows it."""
    parts = ["# Commands\n"]
    for name in commands():
        shown = io.StringIO()
        with redirect_stdout(shown):
            run_command([name, "--help"])
        parts.append(f"## station {name}\n\n```text\n{shown.getvalue().strip()}\n```\n")
    return "\n".join(parts)


def _schema_page(kind: str) -> str:
    """Every block of a file with its keys, types, defaults and limits."""
    import json

    schema = json.loads(schema_text(kind))
    title = {"recipe": "Keys of a recipe", "product": "Keys of a product", "config": "Keys of config.yaml"}[kind]
    blocks = {"": schema, **{n: d for n, d in schema.get("$defs", {}).items() if "properties" in d}}
    return "\n".join([f"# {title}\n", *(_block(name, block) for name, block in blocks.items())])


def _block(name: str, block: dict[str, Any]) -> str:
    head = [f"## {name}\n"] if name else []
    head.append(str(block.get("description", "")).replace("\n", " ") + "\n")
    return "\n".join([*head, "| key | value | default |", "|---|---|---|", *_rows(block), ""])


def _rows(block: dict[str, Any]) -> Iterator[str]:
    for key, value in block["properties"].items():
        default = "required" if key in block.get("required", ()) else repr(value.get("default", ""))
        yield f"| `{key}` | {_kind(value)} | {_cell(default)} |"


def _kind(value: dict[str, Any]) -> str:
    """What a value may be, in words."""
    if "$ref" in value:
        return str(value["$ref"]).rpartition("/")[2]
    if "anyOf" in value:
        return " or ".join(_kind(v) for v in value["anyOf"] if v.get("type") != "null")
    if "enum" in value or "const" in value:
        return ", ".join(f"`{v}`" for v in value.get("enum", [value.get("const")]))
    limits = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    words = [str(value.get("type", "any")), *(f"{sign} {value[k]:g}" for k, sign in limits.items() if k in value)]
    if "items" in value and isinstance(value["items"], dict):
        words.append(f"of {_kind(value['items'])}")
    return _cell(" ".join(words))


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")[:120]


if __name__ == "__main__":
    raise SystemExit(main())
