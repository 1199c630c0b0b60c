"""Geoms of a compiled MuJoCo model as shapes of a URDF."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from gdg.errors import raise_if_any
from gdg.hands.intake.description import Description, Mesh
from gdg.hands.intake.mesh_files import unique_name
from gdg.hands.intake.mjcf_model import MjcfModel, among, pose
from gdg.hands.urdf import Shape

#: The group of geoms that is shown as collision geoms by convention.
COLLISION_GROUP = 3


class GeomReader:
    """Converts geoms; their meshes are added to the description.

    Args:
        model: the compiled model.
        description: gets meshes and repairs.
        missing: meshes whose files were not found, by name.
    """

    def __init__(self, model: MjcfModel, description: Description, missing: dict[str, str]):
        self.types = model.engine.mjtGeom
        self.model = model
        self.description = description
        self.missing = missing
        self._names: dict[int, str] = {}
        self._lost: list[str] = []
        self._mistakes: list[str] = []
        pairs = [np.asarray(ids).ravel() for ids in (model.raw.pair_geom1, model.raw.pair_geom2)]
        self._paired = {int(geom) for geom in np.concatenate(pairs)}

    def shapes(
        self, body: int, link: str, T_link_body: np.ndarray
    ) -> tuple[tuple[Shape, ...], tuple[Shape, ...]]:
        """Visual and collision shapes of a body, in the frame of its link."""
        raw = self.model.raw
        first = int(raw.body_geomadr[body])
        visuals: list[Shape] = []
        collisions: list[Shape] = []
        for geom in range(first, first + int(raw.body_geomnum[body])) if first >= 0 else ():
            collides = self._collides(geom)
            if not self._is_missing(geom, link, collides):
                T_link_geom = T_link_body @ pose(raw.geom_pos[geom], raw.geom_quat[geom])
                (collisions if collides else visuals).extend(self._convert(geom, T_link_geom))
        return tuple(visuals), tuple(collisions)

    def finish(self) -> None:
        """Says what was left out; refuses a model that lacks a collision mesh."""
        raise_if_any(self._mistakes)
        if self._lost:
            self.description.repairs.append(
                f"Dropped visual meshes (for pictures only): {'; '.join(self._lost[:4])}: no file."
            )

    def _collides(self, geom: int) -> bool:
        raw = self.model.raw
        return bool(
            raw.geom_contype[geom]
            or raw.geom_conaffinity[geom]
            or raw.geom_group[geom] == COLLISION_GROUP
            or geom in self._paired
        )

    def _is_missing(self, geom: int, link: str, collides: bool) -> bool:
        mesh = int(self.model.raw.geom_dataid[geom])
        name = self.model.raw.mesh(mesh).name if self._is_mesh(geom) else ""
        if name not in self.missing:
            return False
        text = f"link '{link}', mesh '{self.missing[name]}'"
        if collides:
            self._mistakes.append(f"{self.model.path}: {text}: there is no such file.")
        else:
            self._lost.append(text)
        return True

    def _is_mesh(self, geom: int) -> bool:
        kinds = self.types.mjGEOM_MESH, self.types.mjGEOM_SDF
        return among(self.model.raw.geom_type[geom], *kinds)

    def _convert(self, geom: int, T_link_geom: np.ndarray) -> list[Shape]:
        kinds, kind = self.types, self.model.raw.geom_type[geom]
        a, b, c = (float(value) for value in self.model.raw.geom_size[geom])
        if among(kind, kinds.mjGEOM_BOX):
            return [Shape("box", (2 * a, 2 * b, 2 * c), T_link_geom)]
        if among(kind, kinds.mjGEOM_SPHERE):
            return [Shape("sphere", (a,), T_link_geom)]
        if among(kind, kinds.mjGEOM_CYLINDER):
            return [Shape("cylinder", (a, 2 * b), T_link_geom)]
        if among(kind, kinds.mjGEOM_CAPSULE):
            ends = [Shape("sphere", (a,), T_link_geom @ pose([0, 0, end])) for end in (-b, b)]
            return [Shape("cylinder", (a, 2 * b), T_link_geom), *ends]
        if among(kind, kinds.mjGEOM_ELLIPSOID):
            ball = trimesh.creation.icosphere(3).apply_scale([a, b, c])
            name = unique_name(Path(f"ellipsoid_{geom}.stl"), self.description.meshes)
            self.description.meshes[name] = Mesh(ball)
            return [Shape("mesh", (1.0, 1.0, 1.0), T_link_geom, name)]
        if self._is_mesh(geom):
            return [Shape("mesh", (1.0, 1.0, 1.0), T_link_geom, self._mesh(geom))]
        return []  # planes are no part of a hand

    def _mesh(self, geom: int) -> str:
        """The name of a geom's mesh, whose vertices MuJoCo has moved into the geom's frame."""
        raw, mesh = self.model.raw, int(self.model.raw.geom_dataid[geom])
        if mesh not in self._names:
            first, first_face = int(raw.mesh_vertadr[mesh]), int(raw.mesh_faceadr[mesh])
            vertices = raw.mesh_vert[first : first + int(raw.mesh_vertnum[mesh])]
            faces = raw.mesh_face[first_face : first_face + int(raw.mesh_facenum[mesh])]
            made = trimesh.Trimesh(np.array(vertices, np.float64), np.array(faces, np.int64))
            name = unique_name(Path(f"{raw.mesh(mesh).name}.stl"), self.description.meshes)
            self.description.meshes[name] = Mesh(made)
            self._names[mesh] = name
        return self._names[mesh]
