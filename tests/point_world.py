"""A world without contacts: a mass on a spring, exact enough to say what a trial must give."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from gdg.simulation.world import GraspWorld, ObjectState, Touch


@dataclass
class PointWorld(GraspWorld):
    """A grip that holds an object in place up to some acceleration, and lets it go beyond.

    Attributes:
        grip: largest acceleration that is held, per direction of the force, m/s².
        timestep: seconds.
        turn: how far a force along a direction turns the object, which comes back without it, rad.
        drift: how far the object moves along x in the first step after a reset, metres.
        log: what was called, for order.
    """

    grip: dict[tuple[int, ...], float] = field(default_factory=dict)
    default_grip: float = math.inf
    turn: dict[tuple[int, ...], float] = field(default_factory=dict)
    timestep: float = 0.01
    drift: float = 0.0
    log: list[str] = field(default_factory=list)
    on_the_table: bool = False
    lowered: float = 0.0
    _center: np.ndarray = field(default_factory=lambda: np.zeros(3))
    _speed: np.ndarray = field(default_factory=lambda: np.zeros(3))
    _free: bool = False
    _angle: float = 0.0

    def reset(self, T_object_root: np.ndarray, joints: np.ndarray, targets: np.ndarray) -> None:
        self.log.append("reset")
        self._center, self._speed, self._free = np.zeros(3), np.zeros(3), False
        self._angle = 0.0

    def reset_alone(self) -> None:
        self.reset(np.eye(4), np.zeros(1), np.zeros(1))
        self._free = True

    def step(self, count: int, acceleration: np.ndarray | None = None) -> None:
        self.log.append(f"step {count}")
        if len(self.log) == 2 and self.log[0] == "reset":
            self._center = self._center + np.array([self.drift, 0.0, 0.0])
        force = np.zeros(3) if acceleration is None else np.asarray(acceleration)
        way = tuple(int(value) for value in np.sign(np.round(force, 9)))
        if np.linalg.norm(force) > self.grip.get(way, self.default_grip) + 1e-9:
            self._free = True
        self._angle = self.turn.get(way, 0.0)
        if self._free:
            for _ in range(count):
                self._speed = self._speed + force * self.timestep
                self._center = self._center + self._speed * self.timestep

    def object_state(self) -> ObjectState:
        half = self._angle / 2
        quat_wxyz = np.array([math.cos(half), 0.0, math.sin(half), 0.0])
        return ObjectState(self._center, quat_wxyz, self._speed, np.zeros(3))

    def touch(self) -> Touch:
        return Touch(not self._free, 0.0)

    def lower_table(self, distance: float) -> None:
        self.lowered = distance

    def on_table(self) -> bool:
        return self.on_the_table

    def save(self) -> tuple[np.ndarray, np.ndarray, bool]:
        return self._center, self._speed, self._free

    def restore(self, snapshot: tuple[np.ndarray, np.ndarray, bool]) -> None:
        self.log.append("restore")
        self._center, self._speed, self._free = snapshot
