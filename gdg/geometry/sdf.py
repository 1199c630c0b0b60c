"""Signed-distance grid of a mesh: positive outside, with gradients, on any device."""

from __future__ import annotations

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

from gdg.geometry.mesh import close_gaps, sample_surface

#: Cells along the longest side of the grid: 1 mm for an object of 12 cm.
RESOLUTION = 128
#: Space around the mesh that the grid covers, metres; beyond it distances are extended.
MARGIN_M = 0.012
#: Exact distances are computed within this many cells of the surface.
BAND_CELLS = 2.0


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
    do no harm, nor do gaps of less than a cell (see ``close_gaps`` for larger ones). Distances
    are exact near the surface; elsewhere they are taken to the closest point of the nearest node
    of that band.
    """
    low, high = mesh.bounds[0] - MARGIN_M, mesh.bounds[1] + MARGIN_M
    spacing = float((high - low).max()) / (RESOLUTION - 1)
    shape = np.ceil((high - low) / spacing).astype(int) + 1
    axes = [low[k] + spacing * np.arange(shape[k]) for k in range(3)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    band = _near_surface(mesh, nodes, spacing)
    distance, closest = _exact(mesh, nodes, band)
    sign = _signs(mesh, nodes, band)
    nearest: Any = distance_transform_edt(~band, return_distances=False, return_indices=True)
    far = np.linalg.norm(nodes - closest[tuple(nearest)], axis=-1)
    values = sign * np.where(band, distance, far)
    return {
        "values": values.astype(np.float32),
        "origin": low.astype(np.float32),
        "spacing": np.array(spacing),
    }


def closed_surface(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """A closed manifold in place of a mesh with gaps or overlapping bodies, same frame."""
    arrays = signed_distance_arrays(close_gaps(mesh)[0])
    values, origin = torch.from_numpy(arrays["values"]), torch.from_numpy(arrays["origin"])
    return SignedDistanceGrid(values, origin, float(arrays["spacing"])).zero_surface()


def _near_surface(mesh: trimesh.Trimesh, nodes: np.ndarray, spacing: float) -> np.ndarray:
    """Which nodes lie within about ``BAND_CELLS`` cells of the surface."""
    # 40 samples per cell face leave no surface cell empty
    count = int(np.clip(40 * mesh.area / spacing**2, 20_000, 1_500_000))
    cloud = sample_surface(mesh, count, seed=0)[0]
    near = np.zeros(nodes.shape[:3], bool)
    index = np.round((cloud - nodes[0, 0, 0]) / spacing).astype(int)
    near[tuple(np.clip(index, 0, np.array(near.shape) - 1).T)] = True
    return np.asarray(distance_transform_edt(~near)) <= BAND_CELLS


def _exact(
    mesh: trimesh.Trimesh, nodes: np.ndarray, band: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Unsigned distance and closest surface point of the nodes in the band (zero elsewhere)."""
    vertices, faces = _arrays(mesh)
    squared, _, points = igl.point_mesh_squared_distance(nodes[band], vertices, faces)
    distance, closest = np.zeros(band.shape), np.zeros((*band.shape, 3))
    distance[band], closest[band] = np.sqrt(squared), points
    return distance, closest


def _signs(mesh: trimesh.Trimesh, nodes: np.ndarray, band: np.ndarray) -> np.ndarray:
    """-1 inside, +1 outside: per node in the band, per connected region elsewhere."""
    sign = np.ones(band.shape)
    sign[band] = np.where(winding_numbers(mesh, nodes[band]) > 0.5, -1.0, 1.0)
    labelled: Any = label(~band)
    regions, count = labelled
    names, first = np.unique(regions, return_index=True)
    representatives = nodes.reshape(-1, 3)[first]
    region_sign = np.ones(count + 1)
    region_sign[names] = np.where(winding_numbers(mesh, representatives) > 0.5, -1.0, 1.0)
    return np.where(band, sign, region_sign[regions])


def winding_numbers(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Generalised winding number of points: 1 inside, 0 outside, between near holes; (n,)."""
    vertices, faces = _arrays(mesh)
    return np.asarray(igl.fast_winding_number(vertices, faces, np.ascontiguousarray(points)))


def _arrays(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    vertices = np.ascontiguousarray(mesh.vertices, np.float64)
    return vertices, np.ascontiguousarray(mesh.faces, np.int64)
