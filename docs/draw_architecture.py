"""Draws docs/pictures/architecture.svg from the imports: floors as bands, rooms as boxes as wide as their code.

    python docs/draw_architecture.py

A band stands above every band that it imports. A room's box says its files and lines, and after the arrow the rooms of
its own floor that it imports.
"""

import ast
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import grimp

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "pictures" / "architecture.svg"
WIDTH, LEFT, ROW, GAP, CHAR = 1240, 170, 58, 8, 6.4
COLOURS = ("#e8eef7", "#eef5ea", "#fbf1e3", "#f3ebf5", "#e7f4f4", "#f7e9e9")


@dataclass(frozen=True, slots=True)
class Room:
    """A package or module of a floor. uses: the rooms of its floor that it imports."""

    name: str
    files: int
    lines: int
    uses: tuple[str, ...]


def contracts() -> list[dict[str, Any]]:
    """The import contracts of pyproject.toml."""
    return list(tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"])


def layers(container: str) -> list[str]:
    """What a contract puts above each other in a package, top first; nothing where none does."""
    found: list[str] = next((c["layers"] for c in contracts() if c.get("containers") == [container]), [])
    return [name.strip() for layer in found for name in layer.split("|")]


def rooms(floor: str, graph: grimp.ImportGraph) -> list[Room]:
    """The packages of one floor in the order of their contract, else by name; none where it is one room itself."""
    package = ROOT / "station" / floor
    names = sorted(p.name for p in package.iterdir() if (p / "__init__.py").exists()) if package.is_dir() else []
    order = layers(f"station.{floor}")
    return [_room(floor, name, names, graph) for name in sorted(names, key=lambda n: order.index(n) if order else 0)]


def _room(floor: str, name: str, siblings: list[str], graph: grimp.ImportGraph) -> Room:
    dotted = f"station.{floor}.{name}"
    uses = tuple(
        other
        for other in siblings
        if other != name
        and graph.direct_import_exists(importer=dotted, imported=f"station.{floor}.{other}", as_packages=True)
    )
    files = _files(ROOT / dotted.replace(".", "/"))
    return Room(name, len(files), _lines(files), uses)


def _files(place: Path) -> list[Path]:
    found = place.rglob("*.py") if place.is_dir() else [place.with_suffix(".py")]
    return [path for path in found if path.stat().st_size]


def _lines(files: list[Path]) -> int:
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files)


def purpose(floor: str) -> str:
    """The first line of its docstring."""
    place = ROOT / "station" / floor
    text = (place / "__init__.py" if place.is_dir() else place.with_suffix(".py")).read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]


def draw() -> str:
    """The picture as SVG text."""
    graph = grimp.build_graph("station")
    parts, y = list[str](), 46
    for number, floor in enumerate(layers("station")):
        block, height = _band(floor, rooms(floor, graph), y, COLOURS[number % len(COLOURS)])
        parts += block
        y += height + GAP
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {y}" font-family="sans-serif" font-size="12">'
        f"<title>The station's floors and rooms, drawn from its imports</title>"
        f'<rect width="{WIDTH}" height="{y}" fill="#fff"/>'
        f'<text x="14" y="28" font-size="15" font-weight="bold">Imports go down only</text>'
    )
    return "\n".join([head, *parts, "</svg>", ""])


def _band(floor: str, found: list[Room], y: int, colour: str) -> tuple[list[str], int]:
    rows = list(_rows(found))
    height = 40 + len(rows) * ROW
    files = _files(ROOT / "station" / floor)
    size = f"{len(files)} file{'s' * (len(files) > 1)}, {_lines(files):,} lines"
    parts = [
        f'<rect x="8" y="{y}" width="{WIDTH - 16}" height="{height}" rx="8" fill="{colour}"/>',
        f'<text x="20" y="{y + 25}" font-weight="bold" font-size="14">{escape(floor)}</text>',
        f'<text x="{LEFT}" y="{y + 25}">{escape(purpose(floor))}</text>',
        f'<text x="{WIDTH - 20}" y="{y + 25}" fill="#555" text-anchor="end">{size}</text>',
    ]
    for number, row in enumerate(rows):
        x, top = float(LEFT), y + 36 + number * ROW
        for room, width in row:
            parts += _box(room, x, top, width)
            x += width
    return parts, height


def _box(room: Room, x: float, top: int, width: float) -> list[str]:
    uses = "→ " + ", ".join(room.uses) if room.uses else ""
    return [
        f'<rect x="{x:.0f}" y="{top}" width="{width - 6:.0f}" height="{ROW - 6}" rx="5" fill="#fff" stroke="#8a93a3"/>',
        f'<text x="{x + 8:.0f}" y="{top + 18}" font-weight="bold">{escape(room.name)}</text>',
        f'<text x="{x + 8:.0f}" y="{top + 32}" fill="#555">{room.files} files, {room.lines:,} lines</text>',
        f'<text x="{x + 8:.0f}" y="{top + 44}" fill="#7a4a10" font-size="9">{escape(uses)}</text>',
    ]


def _rows(found: list[Room]) -> Iterator[list[tuple[Room, float]]]:
    """Boxes as wide as their words need, wrapped."""
    row, used = list[tuple[Room, float]](), 0.0
    for room in found:
        uses = 4.9 * (2 + len(", ".join(room.uses)))
        width = max(CHAR * 19, CHAR * 1.2 * len(room.name), uses) + 20
        if used + width > WIDTH - LEFT - 16 and row:
            yield row
            row, used = [], 0.0
        row.append((room, width))
        used += width
    if row:
        yield row


if __name__ == "__main__":
    PICTURE.write_text(draw(), encoding="utf-8")
