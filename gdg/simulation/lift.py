"""The lift of a protocol, in the frame of the hand, whose root stands still in every engine."""

from __future__ import annotations

import numpy as np

from gdg.data.table import Table
from gdg.data.verdict import DIRECTIONS
from gdg.protocols import Direction, Lift
from gdg.simulation.world import GraspWorld


def direction_vector(direction: Direction) -> np.ndarray:
    """The unit vector of a direction such as ``-z``."""
    axis, sign = divmod(DIRECTIONS.index(direction), 2)
    vector = np.zeros(3)
    vector[axis] = -1.0 if sign else 1.0
    return vector


def weight(lift: Lift, table: Table | None) -> np.ndarray:
    """Acceleration by gravity, m/s², in the object's frame."""
    down = direction_vector(lift.direction) if table is None else -table.up
    return lift.gravity * down


def heights(lift: Lift) -> np.ndarray:
    """Height of the hand after each step of the rise, metres, from rest to rest.

    h (10 s³ − 15 s⁴ + 6 s⁵) over s = 0 … 1, the polynomial of least jerk.
    """
    share = np.arange(1, lift.steps + 1) / lift.steps
    return lift.height_m * share**3 * (10 - 15 * share + 6 * share**2)


def accelerations(lift: Lift, timestep: float) -> np.ndarray:
    """Upward acceleration of the hand in each step of the rise, m/s²; ``timestep`` in seconds.

    Differences of the speeds with which ``heights`` are reached, so that an engine that moves a
    table by ``heights`` and an object by these accelerations lets them go the same way.
    """
    speeds = np.diff(heights(lift), prepend=0.0) / timestep
    return np.diff(speeds, prepend=0.0) / timestep


def raise_hand(world: GraspWorld, lift: Lift, timestep: float, table: Table | None) -> None:
    """Lifts, from the state the world is in: weight and inertia act, a table moves away."""
    down = weight(lift, table)
    unit = down / lift.gravity
    for height, acceleration in zip(heights(lift), accelerations(lift, timestep), strict=True):
        if table is not None:
            world.lower_table(float(height))
        world.step(1, down + acceleration * unit)
    if lift.hold_steps:
        world.step(lift.hold_steps, down)
