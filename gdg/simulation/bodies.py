"""The hand as rigid bodies with driven joints, for any physics engine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gdg.hands.hand import Hand
from gdg.hands.urdf import Joint
from gdg.protocols import Protocol
from gdg.simulation.options import SimulatorOptions

#: A motor's rotor inertia acts on a prismatic joint as if through a lever this long, metres.
PRISMATIC_LEVER = 0.05


@dataclass(frozen=True)
class HandBody:
    """One rigid body of the hand: links that fixed joints join.

    Attributes:
        joint: the moving joint that carries it; None for the root body.
        parent: index of the parent body, -1 for the root body.
        T_parent_body: pose in the parent body at joint value zero.
        Ts_body_link: pose of every link of this body, by name.
    """

    joint: Joint | None
    parent: int
    T_parent_body: np.ndarray
    Ts_body_link: dict[str, np.ndarray]


def hand_bodies(hand: Hand) -> list[HandBody]:
    """The hand's rigid bodies, parents before children; the frame of a body is its first link's."""
    bodies = [HandBody(None, -1, np.eye(4), {hand.urdf.root: np.eye(4)})]
    of_link = {hand.urdf.root: 0}
    for joint in hand.urdf.joints.values():
        parent = of_link[joint.parent]
        T_parent_child = bodies[parent].Ts_body_link[joint.parent] @ joint.T_parent_child
        if joint.type == "fixed":
            of_link[joint.child] = parent
            bodies[parent].Ts_body_link[joint.child] = T_parent_child
        else:
            of_link[joint.child] = len(bodies)
            bodies.append(HandBody(joint, parent, T_parent_child, {joint.child: np.eye(4)}))
    return bodies


def moving_limits(hand: Hand, joint: Joint) -> tuple[float, float]:
    """The joint's limits, widened where its master's range takes a mimic joint beyond them."""
    if joint.name in hand.spec.joints:
        return joint.lower, joint.upper
    matrix, offset = hand.coupling
    row = hand.moving_rows[joint.name]
    ends = np.outer(matrix[row], [1, 1]) * np.array(hand.limits()).T
    low, high = ends.min(1).sum() + offset[row], ends.max(1).sum() + offset[row]
    return min(joint.lower, low), max(joint.upper, high)


def all_joints(hand: Hand, actuated: np.ndarray) -> np.ndarray:
    """Values of all moving joints, mimic and passive ones included, in the order of the tree."""
    matrix, offset = hand.coupling
    return matrix @ actuated + offset


@dataclass(frozen=True)
class Drive:
    """Position drive of one joint: N m/rad, N m s/rad, N m and kg m² (N/m … kg if prismatic).

    Attributes:
        force_limit: None: practically unlimited.
        armature: the rotor's inertia as the joint feels it.
    """

    stiffness: float
    damping: float
    force_limit: float | None
    armature: float


def motor_share(hand: Hand, joint: Joint) -> float:
    """The share of a joint's force limit that its motor affords while it turns its other joints.

    A motor turns an actuated joint and those that mimic it, and its force limit is that of the
    actuated joint. By virtual work what it gives is the sum of the joints' forces, each times its
    speed over the actuated joint's. All joints of a motor get the same share of their limits, and
    the sum of the shares is the motor's limit. A passive joint has no motor; what locks it keeps
    its limit.
    """
    matrix, _ = hand.coupling
    motors = np.flatnonzero(matrix[hand.moving_rows[joint.name]])
    if not len(motors):
        return 1.0
    speeds = np.abs(matrix[:, motors[0]])
    drives = hand.spec.drives
    limits = [drives.of(moving.name).force_limit for moving in hand.moving_joints]
    return drives.of(hand.spec.joints[motors[0]]).force_limit / float(speeds @ limits)


def joint_drive(hand: Hand, joint: Joint, protocol: Protocol, options: SimulatorOptions) -> Drive:
    """The drive of a joint: gains of the protocol, or the hand's own where it sets none."""
    own = hand.spec.drives.of(joint.name)
    gains = protocol.drive or own
    limited = protocol.drive is None or options.force_limits
    share = motor_share(hand, joint) if protocol.shared_motors else 1.0
    lever = PRISMATIC_LEVER if joint.type == "prismatic" else 1.0
    return Drive(
        stiffness=gains.stiffness,
        damping=gains.damping,
        force_limit=share * own.force_limit if limited else None,
        armature=options.armature / lever**2,
    )
