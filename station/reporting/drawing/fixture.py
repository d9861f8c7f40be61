"""The unit as a person in front of the fixture sees it: x to the right, z up, y away. A box on its plate, with the
connector on the +x side and the names of its axes on its faces: no two orientations look alike."""

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from station.domain.core import rotation
from station.domain.core.types import Floats

#: The viewer stands to the right and above.
_VIEW = rotation.about(np.array([1.0, 0, 0]), 27.0) @ rotation.about(np.array([0, 0, 1.0]), -38.0)
#: Where the light comes from, station axes: each face shows how far it is turned to it.
_LIGHT = np.array([-0.35, -0.55, 0.95]) / np.linalg.norm([-0.35, -0.55, 0.95])
_SIZE, _SCALE = 220.0, 62.0
#: A face that is seen almost from its edge bears no name; it would lie on its neighbours.
_SMALLEST_LABEL = 12.0
#: Body, plate and connector in the device's axes: lowest and highest corner; the connector is a cylinder about x.
_BODY = (np.array([-0.85, -0.68, -0.36]), np.array([0.85, 0.68, 0.44]))
_PLATE = (np.array([-1.05, -0.74, -0.52]), np.array([1.05, 0.74, -0.36]))
#: Names on faces, and their size: +x stands on the connector, −z under the plate.
_BODY_NAMES = {(0, -1): 24.0, (1, 1): 24.0, (1, -1): 24.0, (2, 1): 26.0}
_PLATE_NAMES = {(2, -1): 26.0}
_RING_AT, _RING_TO, _RADIUS, _SIDES = 0.85, 1.25, 0.27, 20
#: Shades from the light to the dark; a page with its own colours overrides them by the classes p0 … p3.
_SHADES = ("#f7fafc", "#d5dde4", "#b4c0cb", "#97a5b2")
_FLOOR_Z, _FLOOR = -1.12, 1.25
#: The arrow of a turn: its radius, at most so much of a circle, its points, and its head's length and half width.
_TURN_RADIUS, _TURN_MOST_DEG, _TURN_POINTS, _TURN_HEAD = 1.3, 150.0, 24, (0.34, 0.2)


def picture(
    pose: Sequence[Sequence[float]] | None, title: str, towards: Sequence[Sequence[float]] | None = None
) -> str:
    """SVG of the unit in an orientation (device → station rotation, 3 × 3); None: the pose is not known.

    towards: the orientation into which a person turns it; an arrow shows the way.
    """
    parts = [_floor()]
    if pose is None:
        parts.append(_label(_SIZE / 2, _SIZE / 2 + 20, "?", 60))
    else:
        parts += _unit(np.asarray(pose, float))
        if towards is not None:
            parts.append(_turn_arrow(np.asarray(towards, float) @ np.asarray(pose, float).T))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_SIZE:g} {_SIZE:g}" role="img" '
        f'font-family="system-ui, sans-serif"><title>{escape(title)}</title>{"".join(parts)}</svg>'
    )


def _unit(pose: Floats) -> list[str]:
    """The three solids, those behind first: planes between them say which is in front of which."""
    towards = pose.T @ _VIEW.T @ np.array([0.0, -1.0, 0.0])  # the way to the viewer, device axes
    body, plate, connector = _box(pose, _BODY, _BODY_NAMES), _box(pose, _PLATE, _PLATE_NAMES), _connector(pose)
    upper = [connector, body] if towards[0] < 0 else [body, connector]
    order = [plate, *upper] if towards[2] > 0 else [*upper, plate]
    return [part for solid in order for part in solid]


def _box(pose: Floats, corners: tuple[Floats, Floats], names: Mapping[tuple[int, int], float]) -> list[str]:
    """The faces that are seen; names: size of the name on the face (axis, sign)."""
    found = []
    for axis in range(3):
        for sign in (1, -1):
            normal = np.zeros(3)
            normal[axis] = sign
            if not _faces_viewer(pose @ normal):
                continue
            a, b = (axis + 1) % 3, (axis + 2) % 3
            face = []
            for u, v in ((1, 1), (1, 0), (0, 0), (0, 1)):
                corner = np.empty(3)
                corner[axis], corner[a], corner[b] = corners[int(sign > 0)][axis], corners[u][a], corners[v][b]
                face.append(pose @ corner)
            found.append(_polygon(face, pose @ normal))
            if (axis, sign) in names:
                found.append(_face_name(pose, axis, sign, corners, names[axis, sign]))
    return found


def _connector(pose: Floats) -> list[str]:
    """A short cylinder along +x: the quads of its side that face the viewer, then its cap."""
    angles = np.linspace(0, 2 * np.pi, _SIDES + 1)
    ring = np.stack([np.zeros_like(angles), _RADIUS * np.cos(angles), _RADIUS * np.sin(angles)], axis=1)
    near, far = ring + np.array([_RING_AT, 0, 0]), ring + np.array([_RING_TO, 0, 0])
    found = []
    for i in range(_SIDES):
        normal = pose @ ((ring[i] + ring[i + 1]) / 2)
        if _faces_viewer(normal):
            quad = [pose @ p for p in (near[i], far[i], far[i + 1], near[i + 1])]
            found.append(_polygon(quad, normal, seam=True, darker=1))
    if _faces_viewer(pose[:, 0]):
        found.append(_polygon([pose @ p for p in far[:-1]], pose[:, 0]))
        corners = np.array([_RING_TO, -_RADIUS, -_RADIUS]), np.array([_RING_TO, _RADIUS, _RADIUS])
        found.append(_face_name(pose, 0, 1, corners, 15))
    return found


def _faces_viewer(normal: Floats) -> bool:
    """Whether a face with this outward normal (station axes) is seen by the viewer, who looks along +y."""
    return bool((_VIEW @ normal)[1] < -1e-6)


def _polygon(corners: Sequence[Floats], normal: Floats, *, seam: bool = False, darker: int = 0) -> str:
    """A face in the shade that the light gives it; seam: without an outline."""
    lit = float(normal @ _LIGHT) / float(np.linalg.norm(normal))
    shade = min(3, (0 if lit > 0.7 else 1 if lit > 0.3 else 2 if lit > -0.35 else 3) + darker)
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(_project, corners))
    name, fill = f"p{shade}", _SHADES[shade]
    line = f'stroke="{fill}" class="{name} seam"' if seam else f'stroke="#22303c" class="{name} edge"'
    return f'<polygon points="{points}" fill="{fill}" {line} stroke-width="1.4" stroke-linejoin="round"/>'


def _face_name(pose: Floats, axis: int, sign: int, corners: tuple[Floats, Floats], size: float) -> str:
    """The axis' name, lying on its face; '' where the face is too narrow for it."""
    a, b = (axis + 1) % 3, (axis + 2) % 3
    centre = (corners[0] + corners[1]) / 2
    centre[axis] = corners[int(sign > 0)][axis]
    sides = [np.eye(3)[a] * sign, np.eye(3)[b]]
    flat = [_project(pose @ s) - _project(np.zeros(3)) for s in sides]
    room = abs(float(flat[0][0] * flat[1][1] - flat[0][1] * flat[1][0])) / _SCALE
    if room < _SMALLEST_LABEL:
        return ""
    # Of the four ways to write it on the face, the one that stands the most upright.
    turns = [(flat[0], flat[1]), (flat[1], -flat[0]), (-flat[0], -flat[1]), (-flat[1], flat[0])]
    along, upward = max(turns, key=lambda t: t[0][0] / np.linalg.norm(t[0]) - t[1][1] / np.linalg.norm(t[1]))
    x, y = _project(pose @ centre)
    matrix = [*(along / _SCALE), *(-upward / _SCALE), x, y]
    place = " ".join(f"{v:.3f}" for v in matrix)
    name = f"{'+' if sign > 0 else '−'}{'xyz'[axis]}"
    return f'<g transform="matrix({place})">{_label(0, size / 3, name, size)}</g>'


def _project(point: Floats) -> Floats:
    x, _, z = _VIEW @ point
    return np.array([_SIZE / 2 + _SCALE * x, _SIZE / 2 - 4 - _SCALE * z])


def _turn_arrow(turn: Floats) -> str:
    """The way of a turn (station axes) on the side that faces the viewer; '' where nothing turns."""
    vector = rotation.to_vector(turn)
    angle = float(np.linalg.norm(vector))
    if angle < 1e-6:
        return ""
    axis = vector / angle
    viewer = _VIEW.T @ np.array([0.0, -1.0, 0.0])
    front = viewer - (viewer @ axis) * axis
    if np.linalg.norm(front) < 0.1:  # one looks along the axis: the whole circle is seen
        front = _VIEW.T @ np.array([0.0, 0.0, -1.0])
        front -= (front @ axis) * axis
    front /= np.linalg.norm(front)
    side = np.cross(axis, front)
    half = min(angle, np.radians(_TURN_MOST_DEG)) / 2
    long, wide = _TURN_HEAD
    at = np.linspace(-half, half, _TURN_POINTS)
    # About the vertical it lies on the floor, where it hides no face.
    centre = _FLOOR_Z * axis * axis[2] if abs(axis[2]) > 0.7 else np.zeros(3)
    way = [centre + _TURN_RADIUS * (np.cos(a) * front + np.sin(a) * side) for a in at]
    ahead = -np.sin(half) * front + np.cos(half) * side
    out = (way[-1] - centre) / _TURN_RADIUS
    head = [way[-1] + wide * out, way[-1] + long * ahead, way[-1] - wide * out]
    line, tip = (" ".join(f"{x:.1f},{y:.1f}" for x, y in map(_project, points)) for points in (way, head))
    return (
        f'<polyline class="turn-way" points="{line}" fill="none" stroke="#0a5aa8" stroke-width="6"/>'
        f'<polygon class="turn-head" points="{tip}" fill="#0a5aa8"/>'
    )


def _floor() -> str:
    """The floor under the unit."""
    corners = [np.array([x * _FLOOR, y * _FLOOR, _FLOOR_Z]) for x, y in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(_project, corners))
    return f'<polygon class="ground" points="{points}" fill="#dce3e9" stroke="#6b7a87" stroke-width="1"/>'


def _label(x: float, y: float, words: str, size: float) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:g}" font-weight="700" text-anchor="middle" '
        f'fill="#14212c">{escape(words)}</text>'
    )
