"""One trial: settle, push six ways, judge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gdg.data.verdict import DIRECTIONS
from gdg.protocols import Protocol

from .scene import GraspScene, ObjectState

#: Unit vectors in the order of ``DIRECTIONS``.
PUSH_VECTORS = tuple(sign * axis for axis in np.eye(3) for sign in (1.0, -1.0))
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

    Attributes:
        overlap: solver's largest overlap after settling, metres.
    """

    failure: str
    displacement: tuple[float, ...]
    rotation: tuple[float, ...]
    drift: float
    contact_kept: tuple[bool, ...]
    overlap: float


@dataclass(frozen=True)
class Push:
    """The object after one push, against the protocol's reference; metres and rad."""

    displacement: float
    rotation: float
    touching: bool


def run_trial(scene: GraspScene, protocol: Protocol, start: Start, complete: bool) -> Trial:
    """Runs the protocol once.

    Args:
        scene: hand and object, built for this protocol.
        protocol: the stability test.
        start: where hand and drives start.
        complete: whether to go through all six pushes when the grasp has failed before.
    """
    scene.reset(start.T_object_root, start.joints, start.targets)
    before = scene.object_state()
    # contacts are only known after a step
    scene.step(max(1, protocol.start.settle_steps))
    settled, overlap = scene.object_state(), scene.touch().overlap
    drift = settled.displacement_from(before)
    failure = _start_failure(protocol, settled, overlap, drift)
    if failure == "diverged" or (failure and not complete):
        return _cut_short(failure, drift, overlap)
    pushes = _push_all(scene, protocol, settled)
    if pushes is None:
        return _cut_short("diverged", drift, overlap)
    return Trial(
        failure or _push_failure(protocol, pushes),
        tuple(push.displacement for push in pushes),
        tuple(push.rotation for push in pushes),
        drift,
        tuple(push.touching for push in pushes),
        overlap,
    )


def free_displacement(scene: GraspScene, protocol: Protocol) -> float:
    """How far one push moves the object when no hand is near, metres."""
    scene.reset_alone()
    before = scene.object_state()
    scene.step(protocol.pushes.steps, protocol.pushes.acceleration * PUSH_VECTORS[0])
    return scene.object_state().displacement_from(before)


def _push_all(scene: GraspScene, protocol: Protocol, settled: ObjectState) -> list[Push] | None:
    """All six pushes, or None when the simulation diverged."""
    pushes, reference = [], settled
    start = scene.save()
    for vector in PUSH_VECTORS:
        if protocol.pushes.order == "reset":
            scene.restore(start)
        elif protocol.success.measured == "per-push":
            reference = scene.object_state()
        scene.step(protocol.pushes.steps, protocol.pushes.acceleration * vector)
        state = scene.object_state()
        if _diverged(state):
            return None
        pushes.append(
            Push(
                state.displacement_from(reference),
                state.rotation_from(reference),
                scene.touch().touching,
            )
        )
    return pushes


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
    success = protocol.success
    together = success.measured == "total" and protocol.pushes.order == "sequential"
    judged = pushes[-1:] if together else pushes
    if success.contact and not all(push.touching for push in pushes):
        return "lost-contact"
    if any(push.displacement > success.max_displacement_m for push in judged):
        return "moved"
    limit = success.max_rotation_rad
    if limit is not None and any(push.rotation > limit for push in judged):
        return "rotated"
    return ""


def _cut_short(failure: str, drift: float, overlap: float) -> Trial:
    """A trial that ended before its pushes were done: NaN stands for what was not measured."""
    count = len(DIRECTIONS)
    unknown = (float("nan"),) * count
    return Trial(failure, unknown, unknown, drift, (False,) * count, overlap)
