"""A hand and an object in one PhysX scene, reused for all grasps of the pair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gdg.data.table import Table
from gdg.hands.hand import Hand
from gdg.objects.model import ObjectModel
from gdg.protocols import Protocol
from gdg.simulation.bodies import all_joints
from gdg.simulation.mass import object_mass
from gdg.simulation.world import GraspWorld, ObjectState, Touch

from .articulation import HandArticulation
from .engine import (
    Surface,
    new_scene,
    object_shape,
    physx,
    pose_from_matrix,
    sapien,
    set_mass,
    table_shape,
    vector,
)
from .options import SapienOptions

#: Hand and object touch where a contact point is nearer than this (metres) or carries load.
TOUCHING_GAP = 1e-5


class GraspScene(GraspWorld):
    """One hand, one object, one protocol; cooked once, reset for every trial.

    Args:
        hand: the hand.
        obj: the object, and the table that it rests on; its frame is the world frame at the start
            of a trial.
        protocol: timestep, friction, density, damping and drives.
        options: the simulator's options.
    """

    def __init__(
        self,
        hand: Hand,
        obj: ObjectModel,
        protocol: Protocol,
        options: SapienOptions,
    ):
        self._timestep = protocol.timestep_ms / 1000.0
        surface = Surface.of_friction(protocol.friction, options.contact_offset_m)
        self.hand = HandArticulation(hand, surface, protocol, options)
        self.body = self._make_object(obj, surface, protocol, options)
        self._entities = [*self.hand.entities, self._object_entity]
        self._table = None if obj.table is None else KinematicTable(obj.table, surface)
        if self._table is not None:
            self._entities.append(self._table.entity)
        self._coupled = hand
        self.actuated = len(hand.spec.joints)
        self._scene, self._system = self._enter_new_scene()

    def _enter_new_scene(self) -> tuple[sapien.Scene, physx.PhysxCpuSystem]:
        """Moves hand and object, cooked as they are, into an empty PhysX scene.

        A used scene remembers pairs, islands and friction anchors, which makes verdicts depend on
        the trials before; a new one takes under a millisecond and repeats them to the last bit.
        """
        for entity in self._entities:
            if entity.scene is not None:
                entity.remove_from_scene()
        scene, system = new_scene(self._timestep)
        for entity in self._entities:
            scene.add_entity(entity)
        return scene, system

    def _renew(self) -> None:
        """An empty scene for hand and object, with the table where it stood."""
        if self._table is not None:
            self._table.put_back()
        self._scene, self._system = self._enter_new_scene()

    def _make_object(
        self, obj: ObjectModel, surface: Surface, protocol: Protocol, options: SapienOptions
    ) -> physx.PhysxRigidDynamicComponent:
        body = physx.PhysxRigidDynamicComponent()
        for mesh in obj.convex_parts:
            body.attach(object_shape(mesh, surface))
        set_mass(body, object_mass(obj, protocol.body))
        body.linear_damping = protocol.body.linear_damping
        body.angular_damping = protocol.body.angular_damping
        body.max_depenetration_velocity = protocol.start.max_depenetration_velocity
        body.disable_gravity = True
        body.sleep_threshold = 0.0
        body.solver_position_iterations = options.position_iterations
        body.solver_velocity_iterations = options.velocity_iterations
        self._object_entity = sapien.Entity()
        self._object_entity.add_component(body)
        return body

    def reset(self, T_object_root: np.ndarray, joints: np.ndarray, targets: np.ndarray) -> None:
        """Starts a trial: everything at rest, the object's frame in the world's.

        Args:
            T_object_root: pose of the hand's root, metres.
            joints: actuated joints, rad or m.
            targets: what the drives aim at, same order and units.
        """
        self._renew()
        zero = np.zeros(3, np.float32)
        self._place_object(sapien.Pose(), zero, zero)
        moving, aims = (all_joints(self._coupled, values) for values in (joints, targets))
        self.hand.place(T_object_root, moving, aims)

    def _place_object(self, pose: sapien.Pose, linear: np.ndarray, angular: np.ndarray) -> None:
        self._object_entity.pose = pose
        self.body.set_linear_velocity(vector(linear))
        self.body.set_angular_velocity(vector(angular))

    def step(self, count: int, acceleration: np.ndarray | None = None) -> None:
        """Simulates ``count`` steps under a force of acceleration (m/s²) × mass at the centre."""
        step, push = self._system.step, self.body.add_force_torque
        if acceleration is None:
            for _ in range(count):
                step()
            return
        force, torque = vector(acceleration), (0.0, 0.0, 0.0)
        for _ in range(count):
            push(force, torque, "acceleration")
            step()

    def object_state(self) -> ObjectState:
        """The object now."""
        pose = self._object_entity.pose
        return ObjectState(
            np.array((pose * self.body.cmass_local_pose).p.tolist()),
            np.array(pose.q.tolist()),
            np.array(self.body.linear_velocity.tolist()),
            np.array(self.body.angular_velocity.tolist()),
        )

    def touch(self) -> Touch:
        """Contact of hand and object in the last step."""
        overlap, touching = 0.0, False
        for contact in self._contacts_of_object():
            for point in contact.points:
                overlap = max(overlap, -point.separation)
                touching |= _touches(point)
        return Touch(touching, overlap)

    def _contacts_of_object(self, with_table: bool = False) -> list[physx.PhysxContact]:
        """Contacts of the object with the hand, or with the table instead."""
        contacts = self._system.get_contacts()
        if self._table is None:
            return [] if with_table else contacts
        table, body = self._table.body, self.body
        return [
            contact
            for contact in contacts
            if body in contact.bodies and (table in contact.bodies) == with_table
        ]

    def lower_table(self, distance: float) -> None:
        """Moves the table to ``distance`` below where it stood, metres, within the next step."""
        assert self._table is not None
        self._table.lower(distance)

    def on_table(self) -> bool:
        """Whether object and table touched in the last step."""
        contacts = self._contacts_of_object(with_table=True)
        return any(_touches(point) for contact in contacts for point in contact.points)

    def save(self) -> Snapshot:
        """The state of hand and object, velocities included."""
        velocities = (self.body.linear_velocity.copy(), self.body.angular_velocity.copy())
        return Snapshot(self.hand.state(), self._object_entity.pose, velocities)

    def restore(self, snapshot: Snapshot) -> None:
        """Returns to a saved state; drive targets are those of the last ``reset``."""
        self._renew()
        self._place_object(snapshot.object_pose, *snapshot.object_velocities)
        self.hand.set_state(*snapshot.joints)


def _touches(point: physx.PhysxContactPoint) -> bool:
    return bool(np.any(point.impulse)) or point.separation <= TOUCHING_GAP


class KinematicTable:
    """A table that goes where it is told and pushes what it meets.

    Attributes:
        entity: to be added to a scene.
        body: its only component.
    """

    def __init__(self, table: Table, surface: Surface):
        self._table = table
        self.body = physx.PhysxRigidDynamicComponent()
        self.body.attach(table_shape(surface))
        self.body.kinematic = True
        self.entity = sapien.Entity()
        self.entity.add_component(self.body)

    def put_back(self) -> None:
        """Stands where the object rests on it; to be called outside a scene or between steps."""
        self.entity.pose = pose_from_matrix(self._table.pose())

    def lower(self, distance: float) -> None:
        """Reaches ``distance`` below that place at the end of the next step."""
        self.body.set_kinematic_target(pose_from_matrix(self._table.pose(distance)))


@dataclass(frozen=True)
class Snapshot:
    """What ``GraspScene.restore`` needs.

    Attributes:
        joints: positions and velocities in PhysX's order, rad and rad/s (m and m/s).
        object_pose: of the object's frame.
        object_velocities: linear (m/s) and angular (rad/s).
    """

    joints: tuple[np.ndarray, np.ndarray]
    object_pose: sapien.Pose
    object_velocities: tuple[np.ndarray, np.ndarray]
