"""The hand as a PhysX articulation with a fixed root."""

from __future__ import annotations

import numpy as np
import trimesh

from gdg.hands.hand import Hand
from gdg.protocols import Protocol
from gdg.simulation.bodies import HandBody, hand_bodies, joint_drive, moving_limits
from gdg.simulation.mass import link_mass

from .engine import Surface, part_shape, physx, pose_from_matrix, sapien, set_mass
from .options import SapienOptions

#: PhysX's way of saying that a drive has no force limit.
UNLIMITED = float(np.finfo(np.float32).max)


class HandArticulation:
    """A hand in a PhysX scene: all moving joints have drives, mimic and passive ones included.

    Mimic joints follow by targets of their own rather than by PhysX constraints, which become
    unstable together with drives.

    Args:
        hand: the hand.
        surface: friction and offsets of its shapes.
        protocol: gives drive gains (or leaves them to the hand) and the depenetration speed.
        options: solver iterations and force-limit policy.

    Attributes:
        entities: to be added to a scene, in this order.
        links: PhysX's links, one per rigid body.
    """

    def __init__(
        self,
        hand: Hand,
        surface: Surface,
        protocol: Protocol,
        options: SapienOptions,
    ):
        self.hand = hand
        self.bodies = hand_bodies(hand)
        self._row = hand.moving_rows
        self.entities: list[sapien.Entity] = []  # links don't keep their entities alive
        self.links = self._make_links(surface, protocol)
        self._articulation = self.links[0].articulation
        self._articulation.sleep_threshold = 0.0
        self._articulation.solver_position_iterations = options.position_iterations
        self._articulation.solver_velocity_iterations = options.velocity_iterations
        self._set_drives(protocol, options)

    def _make_links(
        self, surface: Surface, protocol: Protocol
    ) -> list[physx.PhysxArticulationLinkComponent]:
        links: list[physx.PhysxArticulationLinkComponent] = []
        for body in self.bodies:
            parent = links[body.parent] if body.joint is not None else None
            link = physx.PhysxArticulationLinkComponent(parent)
            entity = sapien.Entity()
            entity.add_component(link)
            self.entities.append(entity)
            meshes = self._attach_shapes(link, body, surface)
            mass = sum(self.hand.urdf.links[name].mass for name in body.Ts_body_link)
            set_mass(link, link_mass(mass, meshes))
            link.disable_gravity = True
            link.max_depenetration_velocity = protocol.start.max_depenetration_velocity
            link.name = next(iter(body.Ts_body_link))
            self._set_joint(link.joint, body)
            links.append(link)
        return links

    def _attach_shapes(
        self, link: physx.PhysxArticulationLinkComponent, body: HandBody, surface: Surface
    ) -> list[trimesh.Trimesh]:
        """Attaches the body's parts and returns them in its frame."""
        meshes = []
        for part in self.hand.parts:
            if part.link in body.Ts_body_link:
                T_body_link = body.Ts_body_link[part.link]
                link.attach(part_shape(part, T_body_link, surface))
                meshes.append(part.mesh.copy().apply_transform(T_body_link))
        return meshes

    def _set_joint(self, made: physx.PhysxArticulationJoint, body: HandBody) -> None:
        if body.joint is None:
            made.type = "fixed"
            return
        # PhysX turns and slides along the x axis of the joint's frame
        T_child_joint = np.asarray(trimesh.geometry.align_vectors([1, 0, 0], body.joint.axis))
        made.name = body.joint.name
        made.type = "prismatic" if body.joint.type == "prismatic" else "revolute"
        made.pose_in_child = pose_from_matrix(T_child_joint)
        made.pose_in_parent = pose_from_matrix(body.T_parent_body @ T_child_joint)
        made.limit = np.array(moving_limits(self.hand, body.joint), np.float32)
        made.friction = 0.0

    def _set_drives(self, protocol: Protocol, options: SapienOptions) -> None:
        for joint in self._articulation.active_joints:
            drive = joint_drive(self.hand, self.hand.urdf.joints[joint.name], protocol, options)
            limit = UNLIMITED if drive.force_limit is None else drive.force_limit
            joint.set_drive_properties(drive.stiffness, drive.damping, limit, "force")
            joint.armature = np.full(joint.dof, drive.armature, np.float32)

    def place(self, T_world_root: np.ndarray, moving: np.ndarray, targets: np.ndarray) -> None:
        """Puts the hand at rest somewhere; joint values of all moving joints, rad or m."""
        # PhysX settles the order of its joints only when the articulation enters a scene
        joints = self._articulation.active_joints
        order = [self._row[joint.name] for joint in joints]
        self._articulation.set_root_pose(pose_from_matrix(T_world_root))
        self.set_state(moving[order], np.zeros(len(order)))
        for joint, row in zip(joints, order, strict=True):
            joint.set_drive_target(float(targets[row]))

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions and velocities, in PhysX's order."""
        return self._articulation.get_qpos().copy(), self._articulation.get_qvel().copy()

    def set_state(self, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Sets what ``state`` gives."""
        self._articulation.set_qpos(qpos.astype(np.float32))
        self._articulation.set_qvel(qvel.astype(np.float32))

    def link_poses(self) -> dict[str, np.ndarray]:
        """T_world_link of every link of the hand, by name."""
        poses = {}
        for body, link in zip(self.bodies, self.links, strict=True):
            T_world_body = link.entity_pose.to_transformation_matrix()
            poses |= {name: T_world_body @ T for name, T in body.Ts_body_link.items()}
        return poses
