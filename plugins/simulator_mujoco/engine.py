"""MuJoCo's specification: an empty scene, collision shapes, mass properties, poses."""

# MuJoCo ships no type stubs:
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
import trimesh

from gdg.errors import GdgError
from gdg.hands.geometry import ConvexPart
from gdg.protocols import Protocol
from gdg.simulation.mass import MassProperties

from .options import MujocoOptions

#: Two shapes collide where the group of one is among those that the other meets, so hand meets
#: object and never itself, and the table meets both.
HAND, OBJECT, TABLE = 1, 2, 4
MEETS = {HAND: OBJECT | TABLE, OBJECT: HAND | TABLE, TABLE: HAND | OBJECT}
#: Contacts are solved with the drives' stiffness and damping in the equations, as PhysX does. With
#: ``implicitfast`` they are not: stiff drives on light links then pinch up to twice too hard, or
#: throw the object out, unless steps are about a millisecond.
INTEGRATOR = "mjINT_DISCRETE"


@dataclass(frozen=True)
class Surface:
    """What every collision shape of a scene has in common.

    MuJoCo takes the larger friction of two shapes, so both have the protocol's. Its contacts are
    springs, critically damped: an overlap decays by 1/e in ``solref[0]``, which stands for PhysX's
    limit to the speed of depenetration (10 mm of overlap go at up to 0.4 m/s). Under load each
    contact point keeps an overlap of its force × (1 - d) × solref[0]² / effective mass: at the
    defaults 0.1 mm where 100 N pinch an object of 32 g, on several points a side.

    Attributes:
        friction: Coulomb coefficient.
        torsional: largest torque about the normal over the normal force, metres; 0: none.
        solref: time constant (s) and damping ratio of a contact's overlap.
        solimp: impedance as a function of the overlap, here a constant.
    """

    friction: float
    torsional: float
    solref: tuple[float, float]
    solimp: tuple[float, float, float, float, float]

    @classmethod
    def of(cls, protocol: Protocol, options: MujocoOptions) -> Surface:
        """The surface of a protocol's friction under these options."""
        # between equal ends width, midpoint and power have no effect
        solimp = (options.impedance, options.impedance, 0.001, 0.5, 2.0)
        solref = (options.contact_time_ms / 1000, 1.0)
        return cls(protocol.friction, protocol.torsional_friction, solref, solimp)


def new_spec(timestep: float, options: MujocoOptions) -> mujoco.MjSpec:
    """An empty scene without gravity; ``timestep`` of the engine in seconds.

    Raises:
        GdgError: the installed MuJoCo is too old.
    """
    integrator = getattr(mujoco.mjtIntegrator, INTEGRATOR, None)
    if integrator is None:
        raise GdgError(
            f"simulator 'mujoco' needs MuJoCo 3.13 or later (its discrete integrator), here is "
            f"{mujoco.__version__}: pip install --upgrade mujoco"
        )
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.compiler.autolimits = False
    spec.compiler.usethread = False
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    option = spec.option
    option.timestep = timestep
    option.gravity = np.zeros(3)
    option.integrator = integrator
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = options.impratio
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    # MuJoCo 4.0.0 factorises sparse ones wrongly
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    # a trial that ends in nonsense must be seen, not started again
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return spec


@contextmanager
def quiet() -> Iterator[None]:
    """Keeps MuJoCo from writing a log file into the working folder when a simulation diverges.

    What it would say shows in the object's state, which a trial judges.
    """
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def set_pose(element: mujoco.MjsBody | mujoco.MjsGeom, T: np.ndarray) -> None:
    """Gives a body or shape the pose of a 4×4 matrix."""
    element.pos = np.asarray(T[:3, 3], np.float64)
    element.quat = quat_wxyz(T[:3, :3])


def quat_wxyz(R: np.ndarray) -> np.ndarray:
    """The quaternion of a rotation matrix."""
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(R, np.float64).reshape(9))
    return quat


def set_mass(body: mujoco.MjsBody, properties: MassProperties, center: np.ndarray) -> None:
    """Gives a body these mass properties, its centre of mass at ``center`` (body frame, m)."""
    body.explicitinertial = True
    body.mass = properties.mass
    body.ipos = center
    body.iquat = quat_wxyz(properties.rotation)
    # rounding can break the triangle inequality of flat bodies, which MuJoCo insists on
    total = properties.moments.sum()
    body.inertia = np.minimum(properties.moments, total - properties.moments)


class ShapeMaker:
    """Adds collision shapes to bodies of a scene.

    Args:
        spec: the scene.
        surface: friction and contact softness of all shapes.
    """

    def __init__(self, spec: mujoco.MjSpec, surface: Surface):
        self._spec = spec
        self.surface = surface
        self._meshes = 0

    def add_part(self, body: mujoco.MjsBody, part: ConvexPart, T_body_link: np.ndarray) -> None:
        """A part of the hand: boxes and spheres as such, the rest as convex mesh."""
        if part.kind == "box":
            geom = self._add(body, HAND)
            geom.type = mujoco.mjtGeom.mjGEOM_BOX
            geom.size = np.asarray(part.size) / 2
            set_pose(geom, T_body_link @ part.T_link_part)
        elif part.kind == "sphere":
            geom = self._add(body, HAND)
            geom.type = mujoco.mjtGeom.mjGEOM_SPHERE
            geom.size = np.array([part.size[0], 0.0, 0.0])
            set_pose(geom, T_body_link @ part.T_link_part)
        else:
            self.add_mesh(body, part.mesh.copy().apply_transform(T_body_link), HAND)

    def add_mesh(self, body: mujoco.MjsBody, convex: trimesh.Trimesh, group: int) -> None:
        """A convex mesh in the body's frame."""
        mesh = self._spec.add_mesh(name=f"mesh{self._meshes}")
        self._meshes += 1
        mesh.uservert = np.asarray(convex.vertices, np.float64).ravel()
        geom = self._add(body, group)
        geom.type = mujoco.mjtGeom.mjGEOM_MESH
        geom.meshname = mesh.name

    def add_plane(self, body: mujoco.MjsBody) -> None:
        """The table's half-space below z = 0 of the body's frame."""
        geom = self._add(body, TABLE)
        geom.type = mujoco.mjtGeom.mjGEOM_PLANE
        geom.size = np.array([1.0, 1.0, 1.0])  # for pictures only

    def _add(self, body: mujoco.MjsBody, group: int) -> mujoco.MjsGeom:
        surface = self.surface
        geom = body.add_geom()
        geom.contype, geom.conaffinity = group, MEETS[group]
        geom.condim = 4 if surface.torsional > 0 else 3
        geom.friction = np.array([surface.friction, surface.torsional, 0.0])
        geom.solref = np.array(surface.solref)
        geom.solimp = np.array(surface.solimp)
        return geom
