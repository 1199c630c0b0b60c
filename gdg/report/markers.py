"""Meshes that explain a picture: patches of contact regions, an arrow, the axes of a frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh

from gdg.geometry.half_spaces import half_spaces
from gdg.geometry.quadrilateral import grid_on
from gdg.hands.geometry import ConvexPart
from gdg.report.meshes import PictureMesh, picture_mesh

#: Patches lie this far above the surface, metres.
LIFT_M = 0.0006
#: A point of a region buried deeper than this stays where it is, so that the mistake shows, metres.
MAX_BURIED_M = 0.003
#: A table is drawn so far around what stands on it, metres.
TABLE_MARGIN_M = 0.12
#: Squares per side of a patch.
STEPS = 8


def region_patch(corners: np.ndarray, parts: Sequence[ConvexPart]) -> PictureMesh:
    """A contact region (4, 3), bent over the surface where that bulges through it; two-sided."""
    points = grid_on(corners, STEPS + 1)
    normal = np.cross(corners[2] - corners[0], corners[3] - corners[1])
    normal = normal / max(float(np.linalg.norm(normal)), 1e-12)
    lift = _way_out(points, normal, parts)
    lift = np.where(lift > MAX_BURIED_M, 0.0, lift) + LIFT_M
    vertices = points + lift[:, None] * normal
    first = (np.arange(STEPS)[:, None] * (STEPS + 1) + np.arange(STEPS)).reshape(-1)
    right, above = first + 1, first + STEPS + 1
    faces = np.concatenate(
        (np.stack((first, right, above + 1), 1), np.stack((first, above + 1, above), 1))
    )
    normals = np.tile(normal, (len(vertices), 1))
    return PictureMesh(
        np.concatenate((vertices, vertices)).astype(np.float32),
        np.concatenate((normals, -normals)).astype(np.float32),
        np.concatenate((faces, faces[:, ::-1] + len(vertices))).astype(np.int32),
    )


def _way_out(points: np.ndarray, direction: np.ndarray, parts: Sequence[ConvexPart]) -> np.ndarray:
    """How far each point must go along a direction to leave all parts, metres."""
    way = np.zeros(len(points))
    for _ in range(2):  # leaving one part may lead into another
        for part in parts:
            faces = half_spaces(part.mesh)
            depth = -faces.heights(points + way[:, None] * direction)
            speed = faces.normals @ direction
            times = np.where(speed > 1e-6, depth / np.maximum(speed, 1e-6), np.inf).min(-1)
            way += np.where((depth > -1e-6).all(-1), times, 0.0)  # an edge belongs to the part
    return way


def arrow_mesh(start: np.ndarray, direction: np.ndarray, length: float) -> PictureMesh:
    """An arrow with a head, metres."""
    radius = 0.035 * length
    head = 0.28 * length
    shaft = trimesh.creation.cylinder(radius, length - head, sections=24)
    shaft.apply_translation((0.0, 0.0, (length - head) / 2))
    tip = trimesh.creation.cone(2.6 * radius, head, sections=24)
    tip.apply_translation((0.0, 0.0, length - head))
    T_link_arrow = np.array(trimesh.geometry.align_vectors((0.0, 0.0, 1.0), direction))
    T_link_arrow[:3, 3] = start
    return picture_mesh([mesh.apply_transform(T_link_arrow) for mesh in (shaft, tip)])


def table_mesh(low: np.ndarray, high: np.ndarray) -> PictureMesh:
    """A table top at z = 0 below a box from ``low`` to ``high`` and around it; two-sided."""
    middle, half = (low[:2] + high[:2]) / 2, (high[:2] - low[:2]).max() / 2 + TABLE_MARGIN_M
    square = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) + middle
    vertices = np.concatenate((square, np.zeros((4, 1))), axis=1).astype(np.float32)
    upward = np.tile(np.array([0, 0, 1], np.float32), (4, 1))
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return PictureMesh(
        np.concatenate((vertices, vertices)),
        np.concatenate((upward, -upward)),
        np.concatenate((faces, faces[:, ::-1] + 4)),
    )


def frame_axes(length: float) -> list[PictureMesh]:
    """Arrows along x, y and z from the origin, metres."""
    return [arrow_mesh(np.zeros(3), axis, length) for axis in np.eye(3)]
