"""An object, loaded: mesh checked, surface points, signed distance, mass properties."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
import trimesh
from jaxtyping import Float
from torch import Tensor

from gdg.cache import cached_arrays, content_hash
from gdg.data.scene import TableScene
from gdg.data.table import Table
from gdg.errors import GdgError
from gdg.folders import OBJECTS
from gdg.geometry.convex import Decomposition, convex_parts
from gdg.geometry.mesh import close_gaps, load_mesh, sample_surface
from gdg.geometry.sdf import SignedDistanceGrid, signed_distance_arrays, winding_numbers
from gdg.objects.spec import MANIFEST, read_object_spec

#: Surface points per object, as the method prescribes.
SURFACE_POINTS = 2048
#: Graspable sizes in metres; beyond them the file's unit is surely not the metre.
MIN_EXTENT_M, MAX_EXTENT_M = 0.005, 1.0
#: Gaps of more than this share of the surface are refused (a toothpaste tube of ContactDB with
#: open ends has 0.10, a box without its lid 0.17).
MAX_GAP_SHARE = 0.12
#: A surface of which more than this share bounds no inside is refused as open.
MAX_OPEN_SHARE = 0.05
#: Probes this far on either side of the surface tell inside from outside, metres.
PROBE_M = 1e-4
#: Parts follow the surface closely, so that simulated contacts are where the contact map says.
DECOMPOSITION = Decomposition(gap_m=0.0001, max_parts=96)


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
        scene: what the object stands on (``gdg.scenes``); None: it floats in free air.
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
    scene: TableScene | None = None

    @property
    def table(self) -> Table | None:
        """The table that the object rests on, in its frame; None in free air."""
        return None if self.scene is None else self.scene.table

    def to(self, device: torch.device) -> ObjectModel:
        """The same object with its tensors on another device."""
        return replace(
            self,
            points=self.points.to(device),
            normals=self.normals.to(device),
            sdf=self.sdf.to(device),
            center_of_mass=self.center_of_mass.to(device),
            inertia=self.inertia.to(device),
        )

    @cached_property
    def radius(self) -> float:
        """Radius of the sphere around the object frame's origin that encloses it, metres."""
        return float(np.linalg.norm(self.mesh.vertices, axis=-1).max())

    @cached_property
    def reach(self) -> float:
        """Radius of the sphere around the centre of mass that encloses it, metres.

        Torques are divided by this to compare them with forces; it doesn't depend on the frame.
        """
        center = self.center_of_mass.cpu().double().numpy()
        return float(np.linalg.norm(self.mesh.vertices - center, axis=-1).max())

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
        GdgError: unreadable, empty, too many faces, of implausible size, or not closed.
    """
    mesh, notes, key = checked_mesh(path, scale)
    computed = content_hash("object-arrays-1", key)
    arrays = cached_arrays("object", computed, lambda: _compute(path, mesh))
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


def checked_mesh(path: Path, scale: float = 1.0) -> tuple[trimesh.Trimesh, tuple[str, ...], str]:
    """An object's mesh in metres, what was repaired, and the content hash that names it.

    Raises:
        GdgError: as ``load_object``.
    """
    mesh = load_mesh(path)
    if not (math.isfinite(scale) and scale > 0):
        raise GdgError(f"object_scale={scale:g}: must be a positive number, e.g. 0.001.")
    if scale != 1.0:
        mesh.apply_scale(scale)
    _check_size(path, mesh)
    mesh, notes = _repair(path, mesh)
    vertices = np.asarray(mesh.vertices, np.float64)
    faces = np.asarray(mesh.faces, np.int64)
    return mesh, notes, content_hash("object-3", vertices.tobytes(), faces.tobytes())


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


@dataclass(frozen=True)
class _Closed:
    """A mesh whose gaps were closed by flat caps.

    Attributes:
        mesh: with the caps.
        gap_share: of the caps in its surface.
        open_share: of its surface that has no inside behind it.
    """

    mesh: trimesh.Trimesh
    gap_share: float
    open_share: float

    @classmethod
    def of(cls, mesh: trimesh.Trimesh) -> _Closed:
        closed, gap_area = close_gaps(mesh)
        points, normals = sample_surface(closed, 4000, seed=0)
        behind = winding_numbers(closed, points - PROBE_M * normals)
        return cls(closed, gap_area / closed.area, float((behind < 0.5).mean()))

    @property
    def encloses(self) -> bool:
        """Whether it has an inside nearly everywhere."""
        return self.open_share <= MAX_OPEN_SHARE


def _repair(path: Path, mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, tuple[str, ...]]:
    """Turns inward faces around and closes small gaps; refuses what encloses nothing."""
    closed, notes = _turned_outward(mesh)
    if closed.gap_share > MAX_GAP_SHARE or not closed.encloses:
        missing = max(closed.gap_share, closed.open_share)
        raise GdgError(
            f"{path}: the mesh is not watertight: {missing:.0%} of its surface is missing or "
            f"encloses nothing, so inside and outside can't be told. Close it first (in Blender: "
            f"3D-Print toolbox, Make Manifold)."
        )
    if closed.gap_share > 0:
        notes += (f"its gaps, {closed.gap_share:.1%} of its surface, were closed by flat caps",)
    elif not closed.mesh.is_watertight:
        notes += ("some of its edges join more than two faces",)
    return closed.mesh, notes


def _turned_outward(mesh: trimesh.Trimesh) -> tuple[_Closed, tuple[str, ...]]:
    """The mesh with its faces' front sides outward, if turning them makes it enclose something."""
    given = _Closed.of(mesh)
    if given.encloses:
        return given, ()
    turned = mesh.copy()
    turned.invert()
    if (closed := _Closed.of(turned)).encloses:
        return closed, ("its faces pointed inward and were turned around",)
    mended = mesh.copy()
    trimesh.repair.fix_normals(mended, multibody=True)
    if (closed := _Closed.of(mended)).encloses:
        return closed, ("some of its faces pointed inward and were turned around",)
    return given, ()


def _compute(path: Path, mesh: trimesh.Trimesh) -> dict[str, np.ndarray]:
    arrays = signed_distance_arrays(mesh)
    points, normals = _outer_surface(path, mesh)
    return {**arrays, "points": points, "normals": normals, **_mass_properties(mesh, arrays)}


def _outer_surface(path: Path, mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Surface points that have the outside in front of them (not those of inner bodies)."""
    points, normals = sample_surface(mesh, 4 * SURFACE_POINTS, seed=0)
    outer = winding_numbers(mesh, points + PROBE_M * normals) < 0.5
    if outer.sum() < SURFACE_POINTS:
        raise GdgError(
            f"{path}: most of the mesh's surface lies inside of it; keep its outer shell only."
        )
    return points[outer][:SURFACE_POINTS], normals[outer][:SURFACE_POINTS]


def _mass_properties(mesh: trimesh.Trimesh, grid: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Exact for a closed single body, else by the cells of the grid (to about 1 %)."""
    if mesh.is_watertight and mesh.body_count == 1:
        exact = mesh.mass_properties
        return {
            "volume": np.array(mesh.volume),
            "center_of_mass": np.asarray(exact["center_mass"]),
            "inertia": np.asarray(exact["inertia"]),
        }
    spacing = float(grid["spacing"])
    # cells that the surface cuts count in proportion
    share = np.clip(0.5 - grid["values"].astype(np.float64) / spacing, 0.0, 1.0)
    cells = np.argwhere(share > 0)
    mass = spacing**3 * share[tuple(cells.T)]
    position = cells * spacing + grid["origin"]
    center = np.average(position, axis=0, weights=mass)
    arm = position - center
    products = (arm * mass[:, None]).T @ arm
    return {
        "volume": np.array(mass.sum()),
        "center_of_mass": center,
        "inertia": np.eye(3) * np.trace(products) - products,
    }
