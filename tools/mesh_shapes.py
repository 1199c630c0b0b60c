"""Closed triangle meshes from profiles, boxes and booleans; everything here is in millimetres.

Solids of revolution are stitched from rings whose point counts follow their circumference, so
triangles stay about ``EDGE`` long from rim to axis instead of ending in a fan of needles.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

Points = NDArray[np.float64]
EDGE = 4.0
"""Default edge length, mm."""


def polyline(*corners: tuple[float, ...], edge: float = EDGE) -> Points:
    """Points (n, 2) along straight lines, about ``edge`` apart.

    Args:
        corners: ``(r, z)``, or ``(r, z, cut)`` to round that corner by a parabola that starts and
            ends ``cut`` mm before and after it (a fillet of that radius on a right angle).
        edge: about the step between points.

    Raises:
        ValueError: two neighbouring cuts overlap.
    """
    points = np.array([corner[:2] for corner in corners], dtype=float)
    cuts = np.array([corner[2] if len(corner) > 2 else 0.0 for corner in corners])
    excess = cuts[1:] + cuts[:-1] - np.linalg.norm(np.diff(points, axis=0), axis=1)
    if excess.max() > 1e-9:
        raise ValueError(f"the cuts at {corners[excess.argmax()]} and the next corner overlap")
    pieces = [points[:1]]
    for i, cut in enumerate(cuts[1:-1], start=1):
        start, end = (_towards(points[i], points[j], cut) for j in (i - 1, i + 1))
        steps = max(1, round(2 * cut / edge)) if cut else 0
        s = np.linspace(0, 1, steps + 1)[:, None]
        pieces.append((1 - s) ** 2 * start + 2 * s * (1 - s) * points[i] + s**2 * end)
    return _subdivided(np.concatenate([*pieces, points[-1:]]), edge)


def curve(*points: tuple[float, float], edge: float = EDGE) -> Points:
    """Points (n, 2), about ``edge`` apart, on the cubic spline through the given ``(r, z)``."""
    knots = np.array(points, dtype=float)
    chord = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    steps = max(2, round(chord[-1] / edge))
    return CubicSpline(chord, knots)(np.linspace(0, chord[-1], steps + 1))


def lathe(profile: ArrayLike, edge: float = EDGE) -> trimesh.Trimesh:
    """The solid swept by a profile that turns around z.

    Args:
        profile: (n, 2) radius and height from the axis, up the outside, back to the axis.
        edge: spacing of the points on each ring.
    """
    return stitch([_ring([0, 0, z], [r, 0, 0], [0, r, 0], edge) for r, z in np.asarray(profile)])


def sweep(
    path: Points, radii: ArrayLike, depth: float = 1.0, edge: float = EDGE
) -> trimesh.Trimesh:
    """A closed tube along a path in the x-z plane, with flat ends.

    Args:
        path: (n, 2) x and z of the centres.
        radii: (n,) or one number: half width of the tube in the plane of the path.
        depth: half width along y, as a multiple of the radius.
        edge: spacing of the points on each ring.
    """
    centres = np.column_stack([path[:, 0], np.zeros(len(path)), path[:, 1]])
    tangents = np.gradient(centres, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    sides = np.cross([0.0, 1.0, 0.0], tangents)
    rings = [centres[:1]]
    for centre, side, radius in zip(centres, sides, np.broadcast_to(radii, len(path))):
        rings.append(_ring(centre, radius * side, [0, radius * depth, 0], edge))
    return stitch([*rings, centres[-1:]])


def stitch(rings: Sequence[Points]) -> trimesh.Trimesh:
    """The closed surface through rings of any point counts; the first and last are one point.

    Rings run counter-clockwise seen from where the last ring lies, so that faces look outward.
    """
    starts = np.concatenate([[0], np.cumsum([len(ring) for ring in rings])])
    faces = []
    for k in range(len(rings) - 1):
        zipped = _zip_rings(len(rings[k]), len(rings[k + 1]))
        faces += [[starts[k + upper] + index for upper, index in face] for face in zipped]
    return trimesh.Trimesh(np.concatenate(rings), faces)


def rounded_box(size: Sequence[float], radius: float = 2.0, edge: float = EDGE) -> trimesh.Trimesh:
    """A box centred at the origin whose edges and corners are rounded.

    Args:
        size: full extents along x, y, z.
        radius: of edges and corners.
        edge: about the side of the square cells.
    """
    half = np.asarray(size, dtype=float) / 2
    ticks = [_box_ticks(h, radius, edge) for h in half]
    box: Any = trimesh.util.concatenate([_box_side(ticks, axis, sign) for axis in range(3)
                                    for sign in (0, -1)])  # fmt: skip
    box.merge_vertices()
    inner = np.clip(box.vertices, radius - half, half - radius)
    outward = box.vertices - inner
    box.vertices = inner + radius * outward / np.linalg.norm(outward, axis=1, keepdims=True)
    return box


def ball(diameter: float, subdivisions: int = 3) -> trimesh.Trimesh:
    """A sphere of ``20 * 4**subdivisions`` nearly equal triangles."""
    return trimesh.creation.icosphere(subdivisions, diameter / 2)


def union(*meshes: trimesh.Trimesh) -> trimesh.Trimesh:
    """One closed surface around all of them."""
    return trimesh.boolean.union(meshes, engine="manifold")


def difference(solid: trimesh.Trimesh, *cutters: trimesh.Trimesh) -> trimesh.Trimesh:
    """What is left of ``solid`` after cutting."""
    return trimesh.boolean.difference([solid, *cutters], engine="manifold")


def placed(
    mesh: trimesh.Trimesh, shift: Sequence[float] = (0, 0, 0), turn: str = "x", degrees: float = 0
) -> trimesh.Trimesh:
    """A copy that is turned about one axis through the origin, then shifted."""
    axis = [float(turn == name) for name in "xyz"]
    matrix = trimesh.transformations.rotation_matrix(np.radians(degrees), axis)
    matrix[:3, 3] = shift
    return mesh.copy().apply_transform(matrix)


def warped(mesh: trimesh.Trimesh, function: Callable[..., Sequence[Points]]) -> trimesh.Trimesh:
    """A copy whose vertices are moved by ``function(x, y, z)``, which must keep orientation."""
    return trimesh.Trimesh(np.column_stack(function(*mesh.vertices.T)), mesh.faces)


def squared(mesh: trimesh.Trimesh, exponent: float) -> trimesh.Trimesh:
    """A copy whose circles around z become superellipses, circumscribed; 2 changes nothing."""

    def push(x: Points, y: Points, z: Points) -> tuple[Points, Points, Points]:
        norm = (np.abs(x) ** exponent + np.abs(y) ** exponent) ** (1 / exponent)
        scale = np.hypot(x, y) / np.maximum(norm, 1e-9)
        return x * scale, y * scale, z

    return warped(mesh, push)


def _towards(point: Points, target: Points, distance: float) -> Points:
    return point + (target - point) * distance / np.linalg.norm(target - point)


def _subdivided(points: Points, edge: float) -> Points:
    pieces = [points[:1]]
    for a, b in pairwise(points):
        length = np.linalg.norm(b - a)
        if length > 1e-9:
            steps = max(1, round(length / edge))
            pieces.append(a + (b - a) * np.arange(1, steps + 1)[:, None] / steps)
    return np.concatenate(pieces)


def _ring(centre: ArrayLike, u: ArrayLike, v: ArrayLike, edge: float) -> Points:
    """Points (n, 3) of an ellipse with half axes u and v; one point where it has no size."""
    a, b = np.linalg.norm(u), np.linalg.norm(v)
    if max(a, b) < 1e-9:
        return np.array([centre], dtype=float)
    count = max(6, round(2 * np.pi * np.hypot(a, b) / np.sqrt(2) / edge))
    angle = 2 * np.pi * np.arange(count)[:, None] / count
    return np.asarray(centre) + np.cos(angle) * np.asarray(u) + np.sin(angle) * np.asarray(v)


def _zip_rings(lower: int, upper: int) -> list[tuple[tuple[int, int], ...]]:
    """Triangles between rings of two point counts, as (0 lower or 1 upper, index in ring)."""
    i, j, faces = 0, 0, []
    steps = [count if count > 1 else 0 for count in (lower, upper)]
    while i < steps[0] or j < steps[1]:
        here, above = (0, i % lower), (1, j % upper)
        if j >= steps[1] or (i < steps[0] and (i + 0.5) * upper <= (j + 0.5) * lower):
            i += 1
            faces.append((here, (0, i % lower), above))
        else:
            j += 1
            faces.append((here, (1, j % upper), above))
    return faces


def _box_ticks(half: float, radius: float, edge: float) -> Points:
    """Grid lines along one axis; those in the rounded ends land at equal angles."""
    arc = max(1, round(np.pi / 4 * radius / edge))
    ends = radius * np.tan(np.linspace(0, np.pi / 4, arc + 1))[1:]
    flat = half - radius
    cells = max(1, round(2 * flat / edge))
    return np.concatenate([-flat - ends[::-1], np.linspace(-flat, flat, cells + 1), flat + ends])


def _box_side(ticks: Sequence[Points], axis: int, sign: int) -> trimesh.Trimesh:
    """One gridded side of a box: at the first (0) or last (-1) tick of ``axis``, facing out."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    grid = np.empty((len(ticks[u]), len(ticks[v]), 3))
    grid[..., axis] = ticks[axis][sign]
    grid[..., u], grid[..., v] = np.meshgrid(ticks[u], ticks[v], indexing="ij")
    index = np.arange(grid[..., 0].size).reshape(grid.shape[:2])
    a, b = index[:-1, :-1].ravel(), index[1:, :-1].ravel()
    c, d = index[1:, 1:].ravel(), index[:-1, 1:].ravel()
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return trimesh.Trimesh(grid.reshape(-1, 3), faces if sign else faces[:, ::-1])
