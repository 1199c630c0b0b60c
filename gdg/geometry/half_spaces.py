"""A convex body as the half-spaces behind its faces: what is inside, and where rays cross it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float

#: A face counts as parallel to a ray if their cosine is at most this.
PARALLEL = 1e-9


@dataclass(frozen=True)
class Crossings:
    """Where parallel rays pass through a convex body; NaN for those that miss it.

    Attributes:
        entry: metres from the start along the direction, negative behind it.
        exit: the same; larger than ``entry``.
        facing: cosine between the direction and the normal of the face at the exit, from 0 to 1;
            defined for rays that miss, too.
    """

    entry: Float[np.ndarray, "ray"]
    exit: Float[np.ndarray, "ray"]
    facing: Float[np.ndarray, "ray"]


@dataclass(frozen=True)
class HalfSpaces:
    """All points x with ``normals @ x <= offsets``.

    Attributes:
        normals: outward unit normals.
        offsets: of the faces' planes from the origin along their normals, metres.
    """

    normals: Float[np.ndarray, "face 3"]
    offsets: Float[np.ndarray, "face"]

    def heights(self, points: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, "point face"]:
        """How far each point lies above the plane of each face, metres; inside none is above 0."""
        return points @ self.normals.T - self.offsets

    def crossings(
        self, starts: Float[np.ndarray, "ray 3"], direction: Float[np.ndarray, "3"]
    ) -> Crossings:
        """Where the lines through some points along a unit vector cross the body."""
        slope, room = self.normals @ direction, -self.heights(starts)
        ahead, behind, level = slope > PARALLEL, slope < -PARALLEL, np.abs(slope) <= PARALLEL
        exits = room[:, ahead] / slope[ahead]
        exit_, facing = exits.min(1), slope[ahead][exits.argmin(1)]
        entry = (room[:, behind] / slope[behind]).max(1)
        hit = (entry < exit_) & (room[:, level] >= 0).all(1)
        return Crossings(np.where(hit, entry, np.nan), np.where(hit, exit_, np.nan), facing)


def half_spaces(mesh: trimesh.Trimesh) -> HalfSpaces:
    """The half-spaces of a closed convex mesh, one per triangle, in its frame and order."""
    normals = np.asarray(mesh.face_normals)
    return HalfSpaces(normals, np.einsum("ij,ij->i", normals, mesh.triangles[:, 0]))
