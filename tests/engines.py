"""What control tests need of each physics engine, by the same names."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import mujoco
import numpy as np
from gdg_plugins.simulator_mujoco.options import MujocoOptions
from gdg_plugins.simulator_mujoco.simulator import MujocoSimulator
from gdg_plugins.simulator_mujoco.world import MujocoWorld
from gdg_plugins.simulator_sapien.options import SapienOptions
from gdg_plugins.simulator_sapien.scene import GraspScene
from gdg_plugins.simulator_sapien.simulator import SapienSimulator

from gdg.data.grasps import GraspSet
from gdg.data.verdict import Verdict
from gdg.hands.hand import Hand
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.protocols import Protocol
from gdg.simulation.simulator import WorldSimulator
from gdg.simulation.world import GraspWorld


@dataclass(frozen=True)
class Inertial:
    """Mass (kg), centre (m) and inertia about it (kg m²) of the object, in its frame."""

    mass: float
    center: np.ndarray
    inertia: np.ndarray


class Engine(ABC):
    """A physics engine under test."""

    name: str

    @abstractmethod
    def simulator(self, **options: object) -> WorldSimulator:
        """The component."""

    @abstractmethod
    def inertial(self, world: GraspWorld) -> Inertial:
        """The object as the engine has it."""

    @abstractmethod
    def forces(self, world: GraspWorld) -> dict[str, float]:
        """Force of each link that touches the object, newton."""

    @abstractmethod
    def link_poses(self, world: GraspWorld) -> dict[str, np.ndarray]:
        """T_world_link of every link."""

    @abstractmethod
    def weld(self, world: GraspWorld) -> None:
        """Nails the object to the world."""

    def substeps(self, world: GraspWorld) -> int:
        """The engine's steps per step of the protocol."""
        return 1

    def world(
        self, hand: Hand, obj: ObjectModel, protocol: Protocol, **options: object
    ) -> GraspWorld:
        """A fresh world."""
        return self.simulator(**options).build_world(hand, obj, protocol)

    def verdict(
        self,
        hand: HandModel,
        obj: ObjectModel,
        grasps: GraspSet,
        protocol: Protocol,
        **options: object,
    ) -> Verdict:
        """The verdict on one grasp."""
        simulator = self.simulator(**options)
        (verdict,) = simulator.simulate(hand, obj, grasps, protocol)
        return verdict


class Sapien(Engine):
    """PhysX."""

    name = "sapien"

    def simulator(self, **options: object) -> WorldSimulator:
        return SapienSimulator(SapienOptions.model_validate(options))

    def inertial(self, world: GraspWorld) -> Inertial:
        assert isinstance(world, GraspScene)
        T = world.body.cmass_local_pose.to_transformation_matrix()
        inertia = T[:3, :3] @ np.diag(world.body.inertia) @ T[:3, :3].T
        return Inertial(world.body.mass, T[:3, 3], inertia)

    def forces(self, world: GraspWorld) -> dict[str, float]:
        assert isinstance(world, GraspScene)
        impulses: dict[str, np.ndarray] = {}
        for contact in world._contacts_of_object():
            (link,) = (body.name for body in contact.bodies if body is not world.body)
            total = np.sum([point.impulse for point in contact.points], axis=0)
            impulses[link] = impulses.get(link, np.zeros(3)) + total
        return {name: float(np.linalg.norm(v)) / world._timestep for name, v in impulses.items()}

    def link_poses(self, world: GraspWorld) -> dict[str, np.ndarray]:
        assert isinstance(world, GraspScene)
        return world.hand.link_poses()

    def weld(self, world: GraspWorld) -> None:
        assert isinstance(world, GraspScene)
        world.body.set_locked_motion_axes([True] * 6)


class Mujoco(Engine):
    """MuJoCo."""

    name = "mujoco"

    def simulator(self, **options: object) -> WorldSimulator:
        return MujocoSimulator(MujocoOptions.model_validate(options))

    def inertial(self, world: GraspWorld) -> Inertial:
        assert isinstance(world, MujocoWorld)
        body = world.model.body("object")
        R = np.zeros(9)
        mujoco.mju_quat2Mat(R, body.iquat)
        R = R.reshape(3, 3)
        center = body.pos + body.ipos
        return Inertial(float(body.mass[0]), center, R @ np.diag(body.inertia) @ R.T)

    def forces(self, world: GraspWorld) -> dict[str, float]:
        assert isinstance(world, MujocoWorld)
        forces: dict[str, np.ndarray] = {}
        for number, other in world._contacts_of_object():
            wrench = np.zeros(6)
            mujoco.mj_contactForce(world.model, world.data, number, wrench)
            frame = world.data.contact.frame[number].reshape(3, 3)
            # on the second shape of the contact
            second = world.model.geom_bodyid[world.data.contact.geom[number, 1]]
            sign = 1.0 if second == world._body else -1.0
            body = world.hand.bodies[world.hand.names.index(world.model.body(other).name)]
            link = next(iter(body.Ts_body_link))
            forces[link] = forces.get(link, np.zeros(3)) + sign * (frame.T @ wrench[:3])
        return {name: float(np.linalg.norm(force)) for name, force in forces.items()}

    def link_poses(self, world: GraspWorld) -> dict[str, np.ndarray]:
        assert isinstance(world, MujocoWorld)
        return world.link_poses()

    def weld(self, world: GraspWorld) -> None:
        assert isinstance(world, MujocoWorld)
        # the inertia of a planet
        joint = world.model.joint("object")
        world.model.dof_armature[joint.dofadr[0] : joint.dofadr[0] + 6] = 1e12

    def substeps(self, world: GraspWorld) -> int:
        assert isinstance(world, MujocoWorld)
        return world.substeps


ENGINES: tuple[Engine, ...] = (Sapien(), Mujoco())
