"""The hand in a MuJoCo scene: bodies, joints and position drives."""

# MuJoCo ships no type stubs:
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import mujoco
import numpy as np

from gdg.hands.hand import Hand
from gdg.protocols import Protocol
from gdg.simulation.bodies import Drive, HandBody, hand_bodies, joint_drive, moving_limits
from gdg.simulation.mass import link_mass

from .engine import ShapeMaker, quat_wxyz, set_mass, set_pose
from .options import MujocoOptions


class HandBodies:
    """A hand in a MuJoCo scene: all moving joints have drives, mimic and passive ones included.

    A drive is an affine actuator, force = stiffness (target - q) - damping v. It has no
    ``forcerange``: at a limit MuJoCo drops the actuator from the implicit equations, and a damped
    drive then chatters between the two limits. Instead ``limit_drives`` scales both gains of a
    drive that would exceed its limit, so that at the start of each step it gives exactly its
    limit.

    Args:
        hand: the hand.
        spec: the scene that it enters.
        shapes: adds its collision shapes.
        protocol: gives drive gains, or leaves them to the hand.
        options: force-limit policy.

    Attributes:
        bodies: the rigid bodies, in the order of ``names``.
        names: of the bodies in the scene.
        limited: whether any drive has a force limit.
    """

    def __init__(
        self,
        hand: Hand,
        spec: mujoco.MjSpec,
        shapes: ShapeMaker,
        protocol: Protocol,
        options: MujocoOptions,
    ):
        self.hand = hand
        self.bodies = hand_bodies(hand)
        # names of a URDF's author could meet ours
        self.names = [f"hand{number}" for number in range(len(self.bodies))]
        made: list[mujoco.MjsBody] = []
        for name, body in zip(self.names, self.bodies, strict=True):
            parent = spec.worldbody if body.joint is None else made[body.parent]
            made.append(self._add_body(parent, name, body, shapes))
        self._joints = [body.joint for body in self.bodies if body.joint is not None]
        self._drives = [joint_drive(hand, joint, protocol, options) for joint in self._joints]
        for number, (body, drive) in enumerate(zip(made[1:], self._drives, strict=True)):
            self._add_joint(spec, body, number, drive, shapes)

    def _add_body(
        self, parent: mujoco.MjsBody, name: str, body: HandBody, shapes: ShapeMaker
    ) -> mujoco.MjsBody:
        made = parent.add_body(name=name)
        set_pose(made, body.T_parent_body)
        made.mocap = body.joint is None  # fixed for the solver, and easily put elsewhere
        meshes = []
        for part in self.hand.parts:
            if part.link in body.Ts_body_link:
                T_body_link = body.Ts_body_link[part.link]
                shapes.add_part(made, part, T_body_link)
                meshes.append(part.mesh.copy().apply_transform(T_body_link))
        given = sum(self.hand.urdf.links[link].mass for link in body.Ts_body_link)
        properties = link_mass(given, meshes)
        set_mass(made, properties, properties.center)
        return made

    def _add_joint(
        self,
        spec: mujoco.MjSpec,
        body: mujoco.MjsBody,
        number: int,
        drive: Drive,
        shapes: ShapeMaker,
    ) -> None:
        joint, slides = self._joints[number], mujoco.mjtJoint.mjJNT_SLIDE
        made = body.add_joint(name=f"joint{number}")
        made.type = slides if joint.type == "prismatic" else mujoco.mjtJoint.mjJNT_HINGE
        made.axis = np.asarray(joint.axis, np.float64)
        made.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        made.range = np.array(moving_limits(self.hand, joint))
        made.solref_limit = np.array(shapes.surface.solref)
        made.solimp_limit = np.array(shapes.surface.solimp)
        made.armature = drive.armature
        actuator = spec.add_actuator(name=f"drive{number}")
        actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
        actuator.target = made.name
        actuator.gaintype = mujoco.mjtGain.mjGAIN_FIXED
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        actuator.gainprm[0] = drive.stiffness
        actuator.biasprm[1:3] = -drive.stiffness, -drive.damping
        actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE
        actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_FALSE

    def enter(self, model: mujoco.MjModel) -> None:
        """Takes the hand's places in the compiled scene; called once."""
        joints = [model.joint(f"joint{number}") for number in range(len(self._joints))]
        self._model = model
        self._q = np.array([joint.qposadr[0] for joint in joints], int)
        self._v = np.array([joint.dofadr[0] for joint in joints], int)
        self._row = [self.hand.moving_rows[joint.name] for joint in self._joints]
        self._mocap = int(model.body(self.names[0]).mocapid[0])
        self._ids = [int(model.body(name).id) for name in self.names]
        self._stiffness = np.array([drive.stiffness for drive in self._drives])
        self._damping = np.array([drive.damping for drive in self._drives])
        limits = [drive.force_limit for drive in self._drives]
        self._limit = np.array([np.inf if limit is None else limit for limit in limits])
        self.limited = bool(np.isfinite(self._limit).any())

    def limit_drives(self, data: mujoco.MjData) -> None:
        """Scales the gains of the drives that would exceed their limits in the next step."""
        velocity = data.qvel[self._v]
        wanted = self._stiffness * (data.ctrl - data.qpos[self._q]) - self._damping * velocity
        scale = np.minimum(1.0, self._limit / np.maximum(np.abs(wanted), 1e-9))
        stiffness = self._stiffness * scale
        self._model.actuator_gainprm[:, 0] = stiffness
        self._model.actuator_biasprm[:, 1] = -stiffness
        self._model.actuator_biasprm[:, 2] = -self._damping * scale

    def place(
        self, data: mujoco.MjData, T_world_root: np.ndarray, moving: np.ndarray, targets: np.ndarray
    ) -> None:
        """Puts the hand at rest somewhere; joint values of all moving joints, rad or m."""
        data.mocap_pos[self._mocap] = T_world_root[:3, 3]
        data.mocap_quat[self._mocap] = quat_wxyz(T_world_root[:3, :3])
        data.qpos[self._q] = moving[self._row]
        data.qvel[self._v] = 0.0
        data.ctrl[:] = targets[self._row]

    def link_poses(self, data: mujoco.MjData) -> dict[str, np.ndarray]:
        """T_world_link of every link of the hand, by name."""
        mujoco.mj_kinematics(self._model, data)
        poses = {}
        for body, number in zip(self.bodies, self._ids, strict=True):
            T_world_body = np.eye(4)
            T_world_body[:3, :3] = data.xmat[number].reshape(3, 3)
            T_world_body[:3, 3] = data.xpos[number]
            poses |= {name: T_world_body @ T for name, T in body.Ts_body_link.items()}
        return poses
