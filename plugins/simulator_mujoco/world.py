"""A hand and an object in one MuJoCo scene, reused for all grasps of the pair."""

# MuJoCo ships no type stubs:
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Iterator
from math import ceil

import mujoco
import numpy as np

from gdg.data.table import Table
from gdg.hands.hand import Hand
from gdg.objects.model import ObjectModel
from gdg.protocols import Protocol
from gdg.simulation.bodies import all_joints
from gdg.simulation.mass import object_mass
from gdg.simulation.world import GraspWorld, ObjectState, Touch

from .engine import OBJECT, ShapeMaker, Surface, new_spec, quiet, set_mass, set_pose
from .hand import HandBodies
from .options import MujocoOptions

#: All that the next step depends on.
STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class MujocoWorld(GraspWorld):
    """One hand, one object, one protocol; compiled once, reset for every trial.

    The object's body has its frame at the centre of mass, so that its free joint holds what
    ``ObjectState`` does.

    Args:
        hand: the hand.
        obj: the object, and the table that it rests on; its frame is the world frame at the start
            of a trial.
        protocol: timestep, friction, density, damping and drives.
        options: the simulator's options.

    Attributes:
        model: the compiled scene.
        data: its state.
        substeps: steps of the engine per step of the protocol.
    """

    def __init__(
        self,
        hand: Hand,
        obj: ObjectModel,
        protocol: Protocol,
        options: MujocoOptions,
    ):
        # a step of 5 ms stays one of 5 ms whatever its last bit
        self.substeps = max(1, ceil(protocol.timestep_ms / options.max_timestep_ms - 1e-9))
        timestep = protocol.timestep_ms / 1000.0 / self.substeps
        spec = new_spec(timestep, options)
        shapes = ShapeMaker(spec, Surface.of(protocol, options))
        self.hand = HandBodies(hand, spec, shapes, protocol, options)
        self._add_object(obj, spec, shapes, protocol)
        self._table = obj.table
        if self._table is not None:
            _add_table(self._table, spec, shapes)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.hand.enter(self.model)
        self._body = int(self.model.body("object").id)
        self._table_body = -1 if self._table is None else int(self.model.body("table").id)
        joint = self.model.joint("object")
        self._q, self._v = int(joint.qposadr[0]), int(joint.dofadr[0])
        dampings = protocol.body.linear_damping, protocol.body.angular_damping
        self._kept = np.repeat([max(0.0, 1.0 - d * timestep) for d in dampings], 3)
        self._damped = any(dampings)
        self._coupled = hand
        self.actuated = len(hand.spec.joints)

    def _add_object(
        self, obj: ObjectModel, spec: mujoco.MjSpec, shapes: ShapeMaker, protocol: Protocol
    ) -> None:
        properties = object_mass(obj, protocol.body)
        self._center = properties.center
        body = spec.worldbody.add_body(name="object")
        body.pos = self._center
        joint = body.add_freejoint()
        joint.name = "object"
        joint.align = mujoco.mjtAlignFree.mjALIGNFREE_FALSE
        set_mass(body, properties, np.zeros(3))
        for part in obj.convex_parts:
            shapes.add_mesh(body, part.copy().apply_translation(-self._center), OBJECT)

    def reset(self, T_object_root: np.ndarray, joints: np.ndarray, targets: np.ndarray) -> None:
        """Starts a trial: everything at rest, the object's frame in the world's.

        Args:
            T_object_root: pose of the hand's root, metres.
            joints: actuated joints, rad or m.
            targets: what the drives aim at, same order and units.
        """
        mujoco.mj_resetData(self.model, self.data)
        self._put_table_back()
        moving, aims = (all_joints(self._coupled, values) for values in (joints, targets))
        self.hand.place(self.data, T_object_root, moving, aims)

    def step(self, count: int, acceleration: np.ndarray | None = None) -> None:
        """Simulates ``count`` steps under a force of acceleration (m/s²) × mass at the centre."""
        model, data = self.model, self.data
        force = np.zeros(3) if acceleration is None else model.body_mass[self._body] * acceleration
        # damping takes its share of a step's velocity before contacts are solved, as in PhysX
        data.xfrc_applied[self._body, :3] = self._kept[:3] * force
        velocity = data.qvel[self._v : self._v + 6]
        with quiet():
            for number in range(count * self.substeps):
                if self._lowered != self._lower_to:
                    self._move_table(number + 1)
                if self.hand.limited:
                    self.hand.limit_drives(data)
                if self._damped:
                    velocity *= self._kept
                mujoco.mj_step(model, data)

    def object_state(self) -> ObjectState:
        """The object now."""
        q, v = self.data.qpos[self._q :], self.data.qvel[self._v :]
        angular = np.zeros(3)
        mujoco.mju_rotVecQuat(angular, v[3:6], q[3:7])  # MuJoCo's is in the body's frame
        return ObjectState(q[:3].copy(), q[3:7].copy(), v[:3].copy(), angular)

    def lower_table(self, distance: float) -> None:
        """Moves the table to ``distance`` below where it stood, metres, within the next step."""
        self._lower_to = distance

    def _put_table_back(self) -> None:
        self._lowered = self._lower_to = 0.0
        if self._table is not None:
            mocap = self.model.body_mocapid[self._table_body]
            self.data.mocap_pos[mocap] = self._table.pose()[:3, 3]

    def _move_table(self, substep: int) -> None:
        """Where the table is in this substep (1 …) of the step that moves it."""
        assert self._table is not None
        way = self._lower_to - self._lowered
        lowered = self._lowered + way * substep / self.substeps
        mocap = self.model.body_mocapid[self._table_body]
        self.data.mocap_pos[mocap] = self._table.pose(lowered)[:3, 3]
        if substep == self.substeps:
            self._lowered = self._lower_to

    def on_table(self) -> bool:
        """Whether object and table touched in the last step."""
        return any(other == self._table_body for _, other in self._contacts_of_object())

    def _contacts_of_object(self) -> Iterator[tuple[int, int]]:
        """Contacts of the object in the last step: number, and the other body."""
        for number, pair in enumerate(self.model.geom_bodyid[self.data.contact.geom]):
            first, second = int(pair[0]), int(pair[1])
            if self._body in (first, second):
                yield number, second if first == self._body else first

    def touch(self) -> Touch:
        """Contact of hand and object in the last step."""
        contacts = self._contacts_of_object()
        numbers = [number for number, other in contacts if other != self._table_body]
        gaps = self.data.contact.dist[numbers].tolist()
        # MuJoCo makes contacts of what overlaps alone; under load something always does
        return Touch(bool(gaps), max(0.0, -min(gaps, default=0.0)))

    def link_poses(self) -> dict[str, np.ndarray]:
        """T_world_link of every link of the hand, by name."""
        return self.hand.link_poses(self.data)

    def save(self) -> np.ndarray:
        """The state of hand and object, velocities and the solver's warm start included."""
        state = np.zeros(mujoco.mj_stateSize(self.model, STATE))
        mujoco.mj_getState(self.model, self.data, state, STATE)
        return state

    def restore(self, snapshot: np.ndarray) -> None:
        """Returns to a saved state; drive targets are those of the last ``reset``."""
        mujoco.mj_setState(self.model, self.data, snapshot, STATE)
        self._put_table_back()


def _add_table(table: Table, spec: mujoco.MjSpec, shapes: ShapeMaker) -> None:
    body = spec.worldbody.add_body(name="table")
    body.mocap = True
    set_pose(body, table.pose())
    shapes.add_plane(body)
