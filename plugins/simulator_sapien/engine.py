"""SAPIEN without a renderer: the import, a bare physics system, poses and collision shapes."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from gdg.hands.geometry import ConvexPart
from gdg.simulation.mass import MassProperties

with warnings.catch_warnings():
    # SAPIEN looks for a Vulkan library when imported; nothing is rendered here
    warnings.simplefilter("ignore")
    import sapien
    import sapien.physx as physx

#: Collision groups (two words of ``PhysxCollisionShape.collision_groups``): shapes collide where
#: the first word of one meets the second of the other, so hand meets object and never itself, and
#: a table meets both.
HAND_GROUPS = [1, 2, 0, 0]
OBJECT_GROUPS = [2, 1, 0, 0]
TABLE_GROUPS = [4, 3, 0, 0]
#: Half the sides of a table's box, metres; wide and thick enough to be a half-space to a hand.
TABLE_HALF = (1.0, 1.0, 0.25)
#: Below this relative speed in m/s PhysX doesn't bounce; restitution is zero in any case.
BOUNCE_THRESHOLD = 0.2


@dataclass(frozen=True)
class Surface:
    """What every collision shape of a scene has in common.

    Attributes:
        material: one material for hand and object, so that any way of combining two gives it.
        contact_offset: metres.
    """

    material: physx.PhysxMaterial
    contact_offset: float

    @classmethod
    def of_friction(cls, friction: float, contact_offset: float) -> Surface:
        """Static and dynamic friction alike, no restitution."""
        return cls(physx.PhysxMaterial(friction, friction, 0.0), contact_offset)

    def finish(
        self, shape: physx.PhysxCollisionShape, groups: list[int]
    ) -> physx.PhysxCollisionShape:
        """Sets offsets and collision groups of a shape and returns it."""
        shape.contact_offset = self.contact_offset
        shape.rest_offset = 0.0
        shape.set_collision_groups(groups)
        return shape


def new_scene(timestep: float) -> tuple[sapien.Scene, physx.PhysxCpuSystem]:
    """An empty scene; ``timestep`` in seconds. Bodies turn gravity off one by one."""
    config = physx.PhysxSceneConfig()
    config.bounce_threshold = BOUNCE_THRESHOLD
    config.enable_pcm = True
    config.enable_tgs = True
    config.enable_friction_every_iteration = True
    config.enable_enhanced_determinism = True
    before = physx.get_scene_config()
    physx.set_scene_config(config)  # SAPIEN's global default, read when a system is made
    try:
        system = physx.PhysxCpuSystem()
    finally:
        physx.set_scene_config(before)
    system.timestep = timestep
    return sapien.Scene([system]), system


def vector(values: Sequence[float] | np.ndarray) -> tuple[float, ...]:
    """Plain floats, as all of SAPIEN's functions and properties take them."""
    return tuple(float(value) for value in values)


def pose_from_matrix(T: np.ndarray) -> sapien.Pose:
    """SAPIEN's pose of a 4×4 matrix."""
    quat_wxyz = trimesh.transformations.quaternion_from_matrix(np.asarray(T, np.float64))
    return sapien.Pose(vector(T[:3, 3]), vector(quat_wxyz))


def set_mass(body: physx.PhysxRigidBodyComponent, properties: MassProperties) -> None:
    """Gives a body these mass properties in place of those of its shapes."""
    T_body_principal = np.eye(4)
    T_body_principal[:3, :3] = properties.rotation
    T_body_principal[:3, 3] = properties.center
    body.mass = properties.mass
    body.cmass_local_pose = pose_from_matrix(T_body_principal)
    body.set_inertia(vector(properties.moments))


def part_shape(
    part: ConvexPart, T_body_link: np.ndarray, surface: Surface
) -> physx.PhysxCollisionShape:
    """The collision shape of a hand's part: boxes and spheres as such, the rest as convex mesh.

    Args:
        part: the part.
        T_body_link: pose of the part's link in the rigid body that carries the shape.
        surface: friction and offsets.
    """
    if part.kind == "box":
        half = tuple(side / 2 for side in part.size)
        shape = physx.PhysxCollisionShapeBox(half, surface.material)
        shape.local_pose = pose_from_matrix(T_body_link @ part.T_link_part)
    elif part.kind == "sphere":
        shape = physx.PhysxCollisionShapeSphere(part.size[0], surface.material)
        shape.local_pose = pose_from_matrix(T_body_link @ part.T_link_part)
    else:
        shape = _convex_mesh(part.mesh, surface)
        shape.local_pose = pose_from_matrix(T_body_link)
    return surface.finish(shape, HAND_GROUPS)


def object_shape(mesh: trimesh.Trimesh, surface: Surface) -> physx.PhysxCollisionShape:
    """The collision shape of one convex part of the object, in the object's frame."""
    return surface.finish(_convex_mesh(mesh, surface), OBJECT_GROUPS)


def table_shape(surface: Surface) -> physx.PhysxCollisionShape:
    """A box whose top is the plane z = 0 of its body."""
    shape = physx.PhysxCollisionShapeBox(TABLE_HALF, surface.material)
    shape.local_pose = sapien.Pose((0.0, 0.0, -TABLE_HALF[2]))
    return surface.finish(shape, TABLE_GROUPS)


def _convex_mesh(mesh: trimesh.Trimesh, surface: Surface) -> physx.PhysxCollisionShape:
    vertices = np.asarray(mesh.vertices, np.float32)
    return physx.PhysxCollisionShapeConvexMesh(vertices, (1.0, 1.0, 1.0), surface.material)
