"""The world of a trial: a hand, an object and a protocol in some physics engine."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

#: Where a hand is put that must not touch anything, metres along -x.
FAR_AWAY = 10.0


@dataclass(frozen=True)
class ObjectState:
    """Where the object is and how it moves, in the world.

    Attributes:
        center: centre of mass, metres.
        quat_wxyz: orientation.
        linear: velocity of the centre of mass, m/s.
        angular: rad/s.
    """

    center: np.ndarray
    quat_wxyz: np.ndarray
    linear: np.ndarray
    angular: np.ndarray

    @property
    def finite(self) -> bool:
        """Whether no value is NaN or infinite."""
        values = (self.center, self.quat_wxyz, self.linear, self.angular)
        return all(bool(np.isfinite(v).all()) for v in values)

    def displacement_from(self, other: ObjectState) -> float:
        """Distance of the two centres of mass, metres."""
        return float(np.linalg.norm(self.center - other.center))

    def rotation_from(self, other: ObjectState) -> float:
        """Angle between the two orientations, rad."""
        sign = 1.0 if self.quat_wxyz @ other.quat_wxyz >= 0 else -1.0
        # |q - p| = 2 sin(angle / 4): unlike the arccos form exact for small angles
        chord = float(np.linalg.norm(self.quat_wxyz - sign * other.quat_wxyz))
        return 4.0 * float(np.arcsin(min(1.0, chord / 2)))


@dataclass(frozen=True)
class Touch:
    """Contact of hand and object: whether they touch and the largest overlap, metres."""

    touching: bool
    overlap: float


class GraspWorld(ABC):
    """One hand, one object, one protocol in a physics engine; reset for every trial.

    The object's frame is the world frame at the start of a trial. The hand's root is fixed. There
    is no gravity: weight and the acceleration of a lift are what ``step`` is given. A world may
    have a ``Table`` (``gdg.data.table``), which hand and object collide with.

    Attributes:
        actuated: number of the hand's actuated joints.
    """

    actuated: int

    @abstractmethod
    def reset(self, T_object_root: np.ndarray, joints: np.ndarray, targets: np.ndarray) -> None:
        """Starts a trial: everything at rest, the object's frame in the world's.

        A trial must not depend on the trials before it.

        Args:
            T_object_root: pose of the hand's root, metres.
            joints: actuated joints in the hand's order, rad or m.
            targets: what the drives aim at, same order and units.
        """

    def reset_alone(self) -> None:
        """Starts a trial in which the object floats free of the hand."""
        away = np.eye(4)
        away[0, 3] = -FAR_AWAY
        nowhere = np.zeros(self.actuated)
        self.reset(away, nowhere, nowhere)

    @abstractmethod
    def step(self, count: int, acceleration: np.ndarray | None = None) -> None:
        """Simulates ``count`` steps under a force of acceleration (m/s²) × mass at the centre.

        The force acts on the object alone; the hand has no weight (a robot compensates it).
        """

    @abstractmethod
    def object_state(self) -> ObjectState:
        """The object now."""

    @abstractmethod
    def touch(self) -> Touch:
        """Contact of hand and object in the last step; a table's contacts don't count."""

    def lower_table(self, distance: float) -> None:
        """Moves the table to ``distance`` below where it stood at ``reset``, metres.

        The motion takes the next step, so that the table has the speed that belongs to it.
        ``reset`` and ``restore`` put it back. Worlds that are never built with a table need
        neither this nor ``on_table``.
        """
        raise NotImplementedError(f"{type(self).__name__} has no table")

    def on_table(self) -> bool:
        """Whether object and table touched in the last step."""
        raise NotImplementedError(f"{type(self).__name__} has no table")

    @abstractmethod
    def save(self) -> Any:
        """The state of hand and object, velocities included."""

    @abstractmethod
    def restore(self, snapshot: Any) -> None:
        """Returns to a saved state; drive targets are those of the last ``reset``."""
