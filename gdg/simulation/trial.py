"""One trial: settle, push six ways, judge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from gdg.data.verdict import DIRECTIONS
from gdg.protocols import Protocol
from gdg.simulation.world import GraspWorld, ObjectState

#: Unit vectors in the order of ``DIRECTIONS``.
PUSH_VECTORS = tuple(sign * axis for axis in np.eye(3) for sign in (1.0, -1.0))
#: When a trial stops. ``end``: after all six pushes, whatever happens. ``named``: as soon as it has
#: failed and no later push can give the failure another name. ``failed``: as soon as it has failed.
Until = Literal["end", "named", "failed"]
#: An object faster than this was thrown out by the solver, m/s.
MAX_PLAUSIBLE_SPEED = 50.0


@dataclass(frozen=True)
class Start:
    """How a trial starts: the root's pose, actuated joints and drive targets, rad or m."""

    T_object_root: np.ndarray
    joints: np.ndarray
    targets: np.ndarray

    def shifted(self, shift: np.ndarray) -> Start:
        """The same with the root moved by ``shift`` metres in the world."""
        T = self.T_object_root.copy()
        T[:3, 3] += shift
        return Start(T, self.joints, self.targets)


@dataclass(frozen=True)
class Trial:
    """What one trial gave; see ``Verdict`` for the fields and their units.

    A push that didn't take place has NaN for displacement and rotation, and no contact kept.

    Attributes:
        overlap: solver's largest overlap after settling, metres.
        diverged: whether the simulation ended in nonsense; the world is then unusable.
    """

    failure: str
    displacement: tuple[float, ...]
    rotation: tuple[float, ...]
    drift: float
    contact_kept: tuple[bool, ...]
    overlap: float
    diverged: bool


@dataclass(frozen=True)
class Push:
    """The object after one push, against the protocol's reference; metres and rad."""

    displacement: float
    rotation: float
    touching: bool


def run_trial(world: GraspWorld, protocol: Protocol, start: Start, until: Until = "end") -> Trial:
    """Runs the protocol once.

    Whether the trial fails is the same for every ``until``; so is the failure's name, but for
    ``failed``. What failed first names the failure of a simulation that diverges later.

    Args:
        world: hand and object, built for this protocol.
        protocol: the stability test.
        start: where hand and drives start.
        until: when to stop.
    """
    world.reset(start.T_object_root, start.joints, start.targets)
    before = world.object_state()
    # contacts are only known after a step
    world.step(max(1, protocol.start.settle_steps))
    settled, overlap = world.object_state(), world.touch().overlap
    drift = settled.displacement_from(before)
    failure = _start_failure(protocol, settled, overlap, drift)
    pushes, diverged = [], failure == "diverged"
    if not diverged and (until == "end" or not failure):
        pushes, diverged = _push_all(world, protocol, settled, until)
    failure = failure or _push_failure(protocol, pushes) or ("diverged" if diverged else "")
    missing = len(DIRECTIONS) - len(pushes)
    unknown = (float("nan"),) * missing
    return Trial(
        failure,
        tuple(push.displacement for push in pushes) + unknown,
        tuple(push.rotation for push in pushes) + unknown,
        drift,
        tuple(push.touching for push in pushes) + (False,) * missing,
        overlap,
        diverged,
    )


def free_displacement(world: GraspWorld, protocol: Protocol) -> float:
    """How far one push moves the object when no hand is near, metres."""
    world.reset_alone()
    before = world.object_state()
    world.step(protocol.pushes.steps, protocol.pushes.acceleration * PUSH_VECTORS[0])
    return world.object_state().displacement_from(before)


def _push_all(
    world: GraspWorld, protocol: Protocol, settled: ObjectState, until: Until
) -> tuple[list[Push], bool]:
    """The pushes up to ``until``, and whether the simulation diverged in the one after them."""
    pushes, reference = [], settled
    start = world.save()
    for vector in PUSH_VECTORS:
        if protocol.pushes.order == "reset":
            world.restore(start)
        elif protocol.success.measured == "per-push":
            reference = world.object_state()
        world.step(protocol.pushes.steps, protocol.pushes.acceleration * vector)
        state = world.object_state()
        if _diverged(state):
            return pushes, True
        pushes.append(
            Push(
                state.displacement_from(reference),
                state.rotation_from(reference),
                world.touch().touching,
            )
        )
        if _is_over(protocol, pushes, until):
            break
    return pushes, False


def _is_over(protocol: Protocol, pushes: list[Push], until: Until) -> bool:
    """Whether a trial may stop after these pushes."""
    if until == "end":
        return False
    failure = _push_failure(protocol, pushes)
    # any later push may still give a failure the name that goes before all others
    foremost = "lost-contact" if protocol.success.contact else "moved"
    return failure == foremost if until == "named" else bool(failure)


def _diverged(state: ObjectState) -> bool:
    return not state.finite or float(np.linalg.norm(state.linear)) > MAX_PLAUSIBLE_SPEED


def _start_failure(protocol: Protocol, settled: ObjectState, overlap: float, drift: float) -> str:
    limits = protocol.start
    if _diverged(settled):
        return "diverged"
    if limits.max_penetration_m is not None and overlap > limits.max_penetration_m:
        return "penetrating"
    if limits.max_drift_m is not None and drift > limits.max_drift_m:
        return "drifted"
    return ""


def _push_failure(protocol: Protocol, pushes: list[Push]) -> str:
    """What the pushes so far fail by, empty if nothing yet."""
    success = protocol.success
    together = success.measured == "total" and protocol.pushes.order == "sequential"
    # in total, only where the object is after the last push counts
    judged = pushes[len(DIRECTIONS) - 1 :] if together else pushes
    if success.contact and not all(push.touching for push in pushes):
        return "lost-contact"
    if any(push.displacement > success.max_displacement_m for push in judged):
        return "moved"
    limit = success.max_rotation_rad
    if limit is not None and any(push.rotation > limit for push in judged):
        return "rotated"
    return ""
