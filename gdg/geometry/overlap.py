"""How deep two convex bodies lie in each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError


@dataclass(frozen=True)
class ConvexBody:
    """The convex hull of some points, or everything within ``radius`` of it.

    Attributes:
        points: (n, 3) metres.
        normals: (face, 3) outward unit normals of the hull's faces; may be empty.
        radius: metres; 0 for a polyhedron, and with a single point a sphere.
    """

    points: np.ndarray
    normals: np.ndarray
    radius: float = 0.0

    def placed(self, T_world_body: np.ndarray) -> ConvexBody:
        """The body at a pose."""
        rotation, shift = T_world_body[:3, :3], T_world_body[:3, 3]
        return ConvexBody(self.points @ rotation.T + shift, self.normals @ rotation.T, self.radius)


def body_of(mesh: trimesh.Trimesh) -> ConvexBody:
    """A convex mesh as a body; normals of coplanar faces once."""
    normals = np.unique(np.round(mesh.face_normals, 6), axis=0)
    lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
    return ConvexBody(np.asarray(mesh.vertices), (normals / np.maximum(lengths, 1e-12)))


def penetration_depth(a: ConvexBody, b: ConvexBody, ignored: float = 0.0) -> float:
    """The shortest way by which one body must move to leave the other, metres; 0 when apart.

    Exact for polyhedra and spheres: the least distance from the origin to a face of the bodies'
    Minkowski difference. Depths that a separating direction shows to be at most ``ignored`` are
    not worked out and given as 0.
    """
    radius = a.radius + b.radius
    if least_overlap(a, b) <= ignored:
        return 0.0
    differences = (a.points[:, None] - b.points).reshape(-1, 3)
    try:
        offsets = ConvexHull(differences).equations[:, 3]
    except QhullError:  # two points, or flat bodies: a sphere each, or nothing to measure
        gap = float(np.linalg.norm(differences, axis=-1).min())
        return max(0.0, radius - gap)
    depth = -float(offsets.max())
    if depth < 0 and radius > 0:
        depth = -_distance_to_origin(differences)
    return max(0.0, depth + radius)


def least_overlap(a: ConvexBody, b: ConvexBody) -> float:
    """The least overlap of the bodies' shadows over some directions: never below the depth.

    The directions are the world's axes, the normals of both bodies and the line through their
    middles; negative when one of them separates the bodies.
    """
    between = a.points.mean(0) - b.points.mean(0)
    length = float(np.linalg.norm(between))
    middle = [between[None] / length] if length > 1e-9 else []
    directions = np.concatenate([np.eye(3), a.normals, b.normals, *middle])
    on_a, on_b = a.points @ directions.T, b.points @ directions.T
    overlaps = np.minimum(on_a.max(0) - on_b.min(0), on_b.max(0) - on_a.min(0))
    return float(overlaps.min()) + a.radius + b.radius


def _distance_to_origin(points: np.ndarray) -> float:
    """Distance of the origin to the convex hull of points that it lies outside of."""
    hull = ConvexHull(points)
    triangles = points[hull.simplices]
    nearest = trimesh.triangles.closest_point(triangles, np.zeros((len(triangles), 3)))
    return float(np.linalg.norm(nearest, axis=-1).min())
