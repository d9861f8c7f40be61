"""The fixture as a person in front of it sees it: x to the right, z up, y away; a block with its axes on its faces."""

from collections.abc import Sequence
from html import escape

import numpy as np

from station.domain.core import rotation
from station.domain.core.types import Floats

#: Half lengths of the block; it is flat, so that up and sideways cannot be mixed up.
_HALF = np.array([1.0, 0.75, 0.4])
#: The viewer stands a little to the right and above.
_VIEW = rotation.about(np.array([1.0, 0, 0]), 24.0) @ rotation.about(np.array([0, 0, 1.0]), -26.0)
_SIZE, _SCALE = 220.0, 62.0
#: A face that is seen almost from its edge bears no name; it would lie on its neighbours.
_SMALLEST_LABEL = 9
_FILL = {"x": "#cfe3f5", "y": "#fbe3c0", "z": "#d3ecd9"}


def picture(pose: Sequence[Sequence[float]] | None, title: str) -> str:
    """SVG of the block in an orientation (device → station rotation, 3 × 3); None: the pose is not known."""
    parts = [_ground()]
    if pose is None:
        parts.append(_text(_SIZE / 2, _SIZE / 2, "?", 60))
    else:
        parts += [_face(np.asarray(pose, float), i, s) for i in range(3) for s in (1, -1) if _is_visible(pose, i, s)]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_SIZE:g} {_SIZE:g}" role="img" '
        f'font-family="system-ui, sans-serif"><title>{escape(title)}</title>{"".join(parts)}</svg>'
    )


def _is_visible(pose: Sequence[Sequence[float]], axis: int, sign: int) -> bool:
    """Whether the face looks towards the viewer, who looks along +y."""
    normal = _VIEW @ np.asarray(pose, float)[:, axis] * sign
    return bool(normal[1] < -1e-6)


def _face(pose: Floats, axis: int, sign: int) -> str:
    a, b = (axis + 1) % 3, (axis + 2) % 3
    corners = []
    for u, v in ((1, 1), (1, -1), (-1, -1), (-1, 1)):
        corner = np.zeros(3)
        corner[[axis, a, b]] = sign * _HALF[axis], u * _HALF[a], v * _HALF[b]
        corners.append(_project(pose @ corner))
    centre = np.mean(corners, axis=0)
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
    name = f"{'+' if sign > 0 else '−'}{'xyz'[axis]}"
    block = f'<polygon points="{points}" fill="{_FILL["xyz"[axis]]}" stroke="#222" stroke-width="2"/>'
    size = min(18, round(0.9 * _narrowest(corners)))
    return block + (_text(centre[0], centre[1] + size / 3, name, size) if size >= _SMALLEST_LABEL else "")


def _narrowest(corners: Sequence[Floats]) -> float:
    """Height of the face over its longer side, px: what room there is for its name."""
    a, b = corners[1] - corners[0], corners[3] - corners[0]
    area = abs(float(a[0] * b[1] - a[1] * b[0]))
    return area / max(float(np.linalg.norm(a)), float(np.linalg.norm(b)), 1e-9)


def _project(point: Floats) -> Floats:
    x, _, z = _VIEW @ point
    return np.array([_SIZE / 2 + _SCALE * x, _SIZE / 2 - _SCALE * z])


def _ground() -> str:
    """The floor, and an arrow that says where up is."""
    arrow = '<path d="M18 62 V22 M11 32 L18 20 L25 32" fill="none" stroke="#222" stroke-width="2.5"/>'
    floor = f'<line x1="10" x2="{_SIZE - 10:g}" y1="206" y2="206" stroke="#555" stroke-width="3"/>'
    return floor + arrow + _text(18, 80, "z", 14)


def _text(x: float, y: float, words: str, size: int) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" font-weight="600" text-anchor="middle" '
        f'fill="#111">{escape(words)}</text>'
    )
