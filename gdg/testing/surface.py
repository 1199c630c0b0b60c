"""Where points lie relative to the surface of one link: the union of its convex parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import igl
import numpy as np

from gdg.geometry.mesh import inside_convex
from gdg.hands.geometry import ConvexPart


@dataclass(frozen=True)
class Nearest:
    """The nearest surface of a union of parts, per point.

    Attributes:
        distance: (point,) metres, negative inside; within overlapping parts the depth in the
            deepest one, which the depth in the union is never less than.
        normals: (point, 3) outward unit normals of the nearest face.
    """

    distance: np.ndarray
    normals: np.ndarray


def nearest_surface(parts: Sequence[ConvexPart], points: np.ndarray) -> Nearest:
    """Signed distance of (point, 3) link-frame points to a link's parts, of which there is one."""
    each = [_of_one(part, np.ascontiguousarray(points, np.float64)) for part in parts]
    distances = np.stack([one.distance for one in each])
    normals = np.stack([one.normals for one in each])
    chosen, rows = distances.argmin(0), np.arange(len(points))
    return Nearest(distances[chosen, rows], normals[chosen, rows])


def _of_one(part: ConvexPart, points: np.ndarray) -> Nearest:
    vertices = np.ascontiguousarray(part.mesh.vertices, np.float64)
    faces = np.ascontiguousarray(part.mesh.faces, np.int64)
    squared, face, _ = igl.point_mesh_squared_distance(points, vertices, faces)
    inside, distance = inside_convex(part.mesh, points, margin=0.0), np.sqrt(squared)
    normals = np.asarray(part.mesh.face_normals)[np.asarray(face)]
    return Nearest(np.where(inside, -distance, distance), normals)
