"""Signed-distance grid of a mesh: positive outside, with gradients, on any device."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import igl
import numpy as np
import torch
import trimesh
from jaxtyping import Float
from scipy.ndimage import distance_transform_edt, label
from torch import Tensor

from gdg.geometry.mesh import close_gaps

#: Cells along the longest side of the grid: 1 mm for an object of 12 cm.
RESOLUTION = 128
#: Space around the mesh that the grid covers, metres; beyond it distances are extended.
MARGIN_M = 0.012
#: Exact distances are computed within this many cells of the surface.
BAND_CELLS = 2.0
#: Nodes further from the surface than this are on the same side of it as their neighbours that are,
#: too: above a half, so that no path leads through a gap of less than a cell.
APART_CELLS = 0.75
#: Triangles of less height don't count as surface, metres: their neighbours are as near.
THINNEST_M = 1e-7
#: Nodes along a side of the blocks that the search for that band begins with; a power of two.
LARGEST_BLOCK = 8


@dataclass(frozen=True)
class SignedDistanceGrid:
    """Signed distance sampled on a regular grid, interpolated trilinearly.

    Attributes:
        values: distance at the nodes, metres, positive outside; axes x, y, z.
        origin: position of node (0, 0, 0), metres, object frame.
        spacing: distance of neighbouring nodes, metres, the same on all axes.
    """

    values: Float[Tensor, "nx ny nz"]
    origin: Float[Tensor, "3"]
    spacing: float

    def to(self, device: torch.device) -> SignedDistanceGrid:
        """The same grid on another device."""
        return replace(self, values=self.values.to(device), origin=self.origin.to(device))

    def distance(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Signed distance of points in the object frame, metres, differentiable in the points.

        Outside the grid it is the value at the nearest point of the grid plus the distance to
        that point: an upper bound, with a gradient that points away from the object.
        """
        flat = points.reshape(-1, 3)
        inside = self._into_grid(flat)
        sampled = self._sample(self.values[None], inside)[:, 0]
        beyond = (flat - inside).square().sum(-1)
        outside = beyond > 0
        extra = torch.where(outside, torch.where(outside, beyond, 1.0).sqrt(), 0.0)
        return (sampled + extra).reshape(points.shape[:-1])

    def normals(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Outward unit normals of the nearest surface, differentiable in the points.

        They are the gradient of the distance, by central differences at the nodes, interpolated
        trilinearly; outside the grid, that of the nearest point of the grid.
        """
        flat = points.reshape(-1, 3)
        sampled = self._sample(self._gradient, self._into_grid(flat))
        return torch.nn.functional.normalize(sampled, dim=-1).reshape(points.shape)

    @cached_property
    def _gradient(self) -> Float[Tensor, "3 nx ny nz"]:
        return self.gradient()

    def gradient(self) -> Float[Tensor, "3 nx ny nz"]:
        """Gradient of the distance at the nodes by central differences, made anew."""
        return torch.stack(torch.gradient(self.values, spacing=self.spacing))

    def _into_grid(self, points: Float[Tensor, "point 3"]) -> Float[Tensor, "point 3"]:
        return torch.minimum(torch.maximum(points, self.origin), self.origin + self.extent)

    @cached_property
    def extent(self) -> Float[Tensor, "3"]:
        """Lengths of the grid's sides, metres."""
        shape = torch.tensor(self.values.shape, device=self.values.device)
        return self.spacing * (shape - 1)

    def _sample(
        self, field: Float[Tensor, "channel nx ny nz"], points: Float[Tensor, "point 3"]
    ) -> Float[Tensor, "point channel"]:
        # grid_sample works through one batch element per thread, so the points are cut in two
        pieces = 2 if len(points) % 2 == 0 and len(points) > 1 else 1
        # it wants coordinates in [-1, 1], the last axis of the field first
        coordinates = (2.0 * (points - self.origin) / self.extent - 1.0).flip(-1)
        sampled = torch.nn.functional.grid_sample(
            field.expand(pieces, *field.shape),
            coordinates.reshape(pieces, -1, 1, 1, 3),
            mode="bilinear",
            padding_mode="border",
            align_corners=True,
        )
        return sampled[..., 0, 0].transpose(1, 2).reshape(len(points), len(field))

    def zero_surface(self) -> trimesh.Trimesh:
        """The closed surface at distance zero, by marching cubes; object frame, metres."""
        import pyvista  # heavy, and only needed when a mesh is no clean solid

        grid = pyvista.ImageData(
            dimensions=self.values.shape,
            spacing=(self.spacing,) * 3,
            origin=self.origin.tolist(),
        )
        values = self.values.cpu().numpy().ravel(order="F")
        surface = grid.contour([0.0], scalars=values, method="flying_edges").triangulate()
        mesh = trimesh.Trimesh(surface.points, surface.faces.reshape(-1, 4)[:, 1:])
        if len(mesh.faces) and mesh.volume < 0:
            mesh.invert()
        return mesh


def signed_distance_arrays(mesh: trimesh.Trimesh) -> dict[str, np.ndarray]:
    """Node values, origin and spacing of a mesh's grid.

    Signs come from the generalised winding number (Jacobson et al. 2013), so overlapping bodies
    do no harm, nor do gaps of less than a cell. Through larger ones signs spread, so ``close_gaps``
    comes first. Distances
    are exact near the surface; elsewhere they are taken to the closest point of the nearest node
    of that band.
    """
    low, high = mesh.bounds[0] - MARGIN_M, mesh.bounds[1] + MARGIN_M
    spacing = float((high - low).max()) / (RESOLUTION - 1)
    shape = np.ceil((high - low) / spacing).astype(int) + 1
    band, near, closest = _near_surface(mesh, low, spacing, shape)
    distance = np.full(shape, np.inf, np.float32)
    distance[band] = near
    feet = np.zeros((*shape, 3), np.float32)
    feet[band] = closest - low
    nearest: Any = distance_transform_edt(
        np.isinf(distance), return_distances=False, return_indices=True
    )
    nodes = spacing * np.moveaxis(np.indices(shape, np.float32), 0, -1)
    values = np.linalg.norm(nodes - feet[tuple(nearest)], axis=-1)
    return {
        "values": _signs(mesh, low, spacing, distance) * values,
        "origin": low.astype(np.float32),
        "spacing": np.array(spacing),
    }


def closed_surface(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """A closed manifold in place of a mesh with gaps or overlapping bodies, same frame."""
    arrays = signed_distance_arrays(close_gaps(mesh)[0])
    values, origin = torch.from_numpy(arrays["values"]), torch.from_numpy(arrays["origin"])
    return SignedDistanceGrid(values, origin, float(arrays["spacing"])).zero_surface()


def _near_surface(
    mesh: trimesh.Trimesh, low: np.ndarray, spacing: float, shape: np.ndarray
) -> tuple[tuple[np.ndarray, ...], np.ndarray, np.ndarray]:
    """The nodes within ``BAND_CELLS`` of the surface, found coarse to fine.

    A block of nodes is looked into only if its centre is so near that one of them may be.

    Returns:
        indices of the nodes per axis, distances (node,) and closest surface points (node, 3).
    """
    vertices, faces = _arrays(mesh)
    faces = faces[_heights(mesh) > THINNEST_M]  # what has no area bounds nothing
    size = LARGEST_BLOCK
    blocks = np.indices(tuple(-(-shape // size))).reshape(3, -1).T * size
    while True:
        centers = low + spacing * (blocks + (size - 1) / 2)
        found: Any = igl.point_mesh_squared_distance(centers, vertices, faces)
        squared, points = found[0], found[2]
        reach = spacing * (BAND_CELLS + math.sqrt(3) * (size - 1) / 2)
        near = squared <= reach**2
        if size == 1:
            return tuple(blocks[near].T), np.sqrt(squared[near]), points[near]
        size //= 2
        octants = size * np.indices((2, 2, 2)).reshape(3, -1).T
        blocks = (blocks[near, None] + octants).reshape(-1, 3)
        blocks = blocks[(blocks < shape).all(1)]


def _heights(mesh: trimesh.Trimesh) -> np.ndarray:
    """The least height of each triangle, metres."""
    longest = np.linalg.norm(mesh.triangles - np.roll(mesh.triangles, 1, axis=1), axis=-1).max(1)
    return 2 * mesh.area_faces / np.maximum(longest, 1e-30)


def _signs(
    mesh: trimesh.Trimesh, low: np.ndarray, spacing: float, distance: np.ndarray
) -> np.ndarray:
    """-1 inside, +1 outside, from the winding numbers of few nodes.

    The surface passes between neighbours only where one of them is near it; what is connected
    away from the surface has the sign of any of its nodes.
    """
    labelled: Any = label(distance > APART_CELLS * spacing)
    regions, count = labelled
    of_region = np.zeros(count + 1, np.int64)
    of_region[regions.ravel()] = np.arange(regions.size)
    at_surface = np.flatnonzero(regions == 0)
    asked = np.concatenate((of_region, at_surface))
    nodes = low + spacing * np.column_stack(np.unravel_index(asked, regions.shape))
    sign = np.where(winding_numbers(mesh, nodes) > 0.5, -1.0, 1.0).astype(np.float32)
    signs = sign[regions]
    signs.flat[at_surface] = sign[count + 1 :]
    return signs


def winding_numbers(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Generalised winding number of points: 1 inside, 0 outside, between near holes; (n,)."""
    vertices, faces = _arrays(mesh)
    return np.asarray(igl.fast_winding_number(vertices, faces, np.ascontiguousarray(points)))


def _arrays(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    vertices = np.ascontiguousarray(mesh.vertices, np.float64)
    return vertices, np.ascontiguousarray(mesh.faces, np.int64)
