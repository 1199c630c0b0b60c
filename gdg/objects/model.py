"""An object, loaded: mesh checked, surface points, signed distance, mass properties."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
import trimesh
from jaxtyping import Float
from torch import Tensor

from gdg.cache import cached_arrays, content_hash
from gdg.errors import GdgError
from gdg.folders import OBJECTS
from gdg.geometry.convex import Decomposition, convex_parts
from gdg.geometry.mesh import load_mesh, sample_surface
from gdg.geometry.sdf import SignedDistanceGrid, signed_distance_arrays, winding_numbers
from gdg.objects.spec import MANIFEST, read_object_spec

#: Surface points per object, as the method prescribes.
SURFACE_POINTS = 2048
#: Graspable sizes in metres; beyond them the file's unit is surely not the metre.
MIN_EXTENT_M, MAX_EXTENT_M = 0.005, 1.0
#: A surface of which more than this share bounds no inside is refused as open.
MAX_OPEN_SHARE = 0.05
#: Probes this far on either side of the surface tell inside from outside, metres.
PROBE_M = 1e-4
#: Parts follow the surface closely, so that simulated contacts are where the contact map says.
DECOMPOSITION = Decomposition(gap_m=0.0001, max_parts=64)


@dataclass(frozen=True)
class ObjectModel:
    """An object to grasp, in its mesh's own frame, metres.

    Attributes:
        name: the object's name.
        path: the mesh file.
        mesh: the checked mesh.
        points: surface points, from a fixed seed, on the outer surface only.
        normals: outward unit normals at the points.
        sdf: signed distance, positive outside.
        volume: m³.
        center_of_mass: metres, for uniform density.
        inertia: about the centre of mass at density 1 kg/m³, kg m².
        notes: what was repaired or noticed, one sentence each.
        split: ``train``, ``test`` or ``""`` when the object has no manifest.
        content_hash: of the mesh's geometry.
    """

    name: str
    path: Path
    mesh: trimesh.Trimesh
    points: Float[Tensor, "object_point 3"]
    normals: Float[Tensor, "object_point 3"]
    sdf: SignedDistanceGrid
    volume: float
    center_of_mass: Float[Tensor, "3"]
    inertia: Float[Tensor, "3 3"]
    notes: tuple[str, ...]
    split: str
    content_hash: str

    def to(self, device: torch.device) -> ObjectModel:
        """The same object with its tensors on another device."""
        return replace(
            self,
            points=self.points.to(device),
            normals=self.normals.to(device),
            sdf=self.sdf.to(device),
        )

    @cached_property
    def radius(self) -> float:
        """Radius of the sphere around the object frame's origin that encloses it, metres."""
        return float(np.linalg.norm(self.mesh.vertices, axis=-1).max())

    @cached_property
    def convex_parts(self) -> list[trimesh.Trimesh]:
        """Convex meshes that stand for the object in physics engines; cached on disk."""
        solid = self.mesh.is_watertight and self.mesh.body_count == 1
        return convex_parts(self.mesh if solid else self.sdf.zero_surface(), DECOMPOSITION)


def find_object(given: str, scale: float = 1.0) -> ObjectModel:
    """Loads the object that a name, a folder's path or a mesh file's path means.

    Args:
        given: what the user wrote.
        scale: factor from the mesh's unit to metres, 0.001 for millimetres.
    """
    found = OBJECTS.find(given)
    if found.path.is_file():
        return load_object(found.path, found.name, scale=scale)
    spec = read_object_spec(found.path)
    mesh = (found.path / spec.mesh).resolve()
    if not mesh.is_relative_to(found.path.resolve()):
        raise GdgError(f"{found.path / MANIFEST}: mesh: '{spec.mesh}' lies outside the folder.")
    return load_object(mesh, spec.name, scale=scale, split=spec.split)


def load_object(path: Path, name: str, scale: float = 1.0, split: str = "") -> ObjectModel:
    """Reads and checks a mesh, and computes what grasping needs; cached by content.

    Raises:
        GdgError: unreadable, empty, too many faces, of implausible size, or open.
    """
    mesh = load_mesh(path)
    if scale != 1.0:
        mesh.apply_scale(scale)
    _check_size(path, mesh)
    notes = _repair(path, mesh)
    vertices = np.asarray(mesh.vertices, np.float64)
    faces = np.asarray(mesh.faces, np.int64)
    key = content_hash("object-3", vertices.tobytes(), faces.tobytes())
    arrays = cached_arrays("object", key, lambda: _compute(mesh))
    tensors = {k: torch.from_numpy(np.asarray(v, np.float32)) for k, v in arrays.items()}
    return ObjectModel(
        name=name,
        path=path,
        mesh=mesh,
        points=tensors["points"],
        normals=tensors["normals"],
        sdf=SignedDistanceGrid(tensors["values"], tensors["origin"], float(arrays["spacing"])),
        volume=float(arrays["volume"]),
        center_of_mass=tensors["center_of_mass"],
        inertia=tensors["inertia"],
        notes=notes,
        split=split,
        content_hash=key,
    )


def _check_size(path: Path, mesh: trimesh.Trimesh) -> None:
    extent = float(mesh.extents.max())
    if extent > MAX_EXTENT_M:
        in_mm = MIN_EXTENT_M < extent / 1000 <= MAX_EXTENT_M
        hint = " It seems to be in millimetres: write object_scale=0.001." if in_mm else ""
        raise GdgError(
            f"{path}: the object is {extent:.4g} m long, more than the {MAX_EXTENT_M:g} m that a "
            f"hand can grasp.{hint}"
        )
    if extent < MIN_EXTENT_M:
        raise GdgError(
            f"{path}: the object is only {extent:.3g} m long. Meshes are read in metres; write "
            f"object_scale=… if this one has another unit."
        )


def _repair(path: Path, mesh: trimesh.Trimesh) -> tuple[str, ...]:
    """Turns an inside-out mesh, and refuses one that encloses nothing."""
    notes = []
    open_share = _open_share(mesh)
    if open_share > 0.5:
        mesh.invert()
        inverted_share = _open_share(mesh)
        if inverted_share < open_share:
            notes.append("its faces pointed inward and were turned around")
            open_share = inverted_share
    if open_share > MAX_OPEN_SHARE:
        raise GdgError(
            f"{path}: the mesh is not watertight: {open_share:.0%} of its surface encloses no "
            f"inside, so no signed distance can be told. Close it first (in Blender: 3D-Print "
            f"toolbox, Make Manifold)."
        )
    if not mesh.is_watertight:
        notes.append("the mesh has small gaps, which winding numbers close")
    return tuple(notes)


def _open_share(mesh: trimesh.Trimesh) -> float:
    points, normals = sample_surface(mesh, 4000, seed=0)
    return float((winding_numbers(mesh, points - PROBE_M * normals) < 0.5).mean())


def _compute(mesh: trimesh.Trimesh) -> dict[str, np.ndarray]:
    arrays = signed_distance_arrays(mesh)
    points, normals = _outer_surface(mesh)
    return {**arrays, "points": points, "normals": normals, **_mass_properties(mesh, arrays)}


def _outer_surface(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Surface points that have the outside in front of them (not those of inner bodies)."""
    points, normals = sample_surface(mesh, 4 * SURFACE_POINTS, seed=0)
    outer = winding_numbers(mesh, points + PROBE_M * normals) < 0.5
    if outer.sum() < SURFACE_POINTS:
        raise GdgError("most of the mesh's surface lies inside of it; keep its outer shell only.")
    return points[outer][:SURFACE_POINTS], normals[outer][:SURFACE_POINTS]


def _mass_properties(mesh: trimesh.Trimesh, grid: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Exact for a closed single body, else by the cells of the signed-distance grid."""
    if mesh.is_watertight and mesh.body_count == 1:
        exact = mesh.mass_properties
        return {
            "volume": np.array(mesh.volume),
            "center_of_mass": np.asarray(exact["center_mass"]),
            "inertia": np.asarray(exact["inertia"]),
        }
    spacing = float(grid["spacing"])
    filled = np.argwhere(grid["values"] < 0) * spacing + grid["origin"]
    center = filled.mean(0)
    arm, cell = filled - center, spacing**3
    products = cell * arm.T @ arm
    return {
        "volume": np.array(len(filled) * cell),
        "center_of_mass": center,
        "inertia": np.eye(3) * np.trace(products) - products,
    }
