"""One trial: settle, push, lift, judge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from gdg.data.table import Table
from gdg.data.verdict import DIRECTIONS
from gdg.protocols import Protocol, Pushes
from gdg.simulation.judgement import (
    NO_LIFT,
    NO_PUSH,
    Lifted,
    Push,
    foremost_failure,
    lift_failure,
    push_failure,
    start_failure,
)
from gdg.simulation.lift import direction_vector, raise_hand, weight
from gdg.simulation.world import GraspWorld, ObjectState

#: When a trial stops. ``end``: after all pushes and the lift, whatever happens. ``named``: as soon
#: as it has failed and nothing later can give the failure another name. ``failed``: as soon as it
#: has failed.
Until = Literal["end", "named", "failed"]
#: An object faster than this was thrown out by the solver, m/s.
MAX_PLAUSIBLE_SPEED = 50.0


@dataclass(frozen=True)
class TrialStart:
    """How a trial starts: the root's pose, actuated joints and drive targets, rad or m."""

    T_object_root: np.ndarray
    joints: np.ndarray
    targets: np.ndarray

    def shifted(self, shift: np.ndarray) -> TrialStart:
        """The same with the root moved by ``shift`` metres in the world."""
        T = self.T_object_root.copy()
        T[:3, 3] += shift
        return TrialStart(T, self.joints, self.targets)


@dataclass(frozen=True)
class Trial:
    """What one trial gave; see ``Verdict`` for the fields and their units.

    A push that didn't take place has NaN for displacement and rotation, and no contact kept; so
    has a lift.

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
    lifted: Lifted = NO_LIFT


def run_trial(
    world: GraspWorld,
    protocol: Protocol,
    start: TrialStart,
    until: Until = "end",
    table: Table | None = None,
    failure: str = "",
) -> Trial:
    """Runs the protocol once.

    Whether the trial fails is the same for every ``until``; so is the failure's name, but for
    ``failed``. What failed first names the failure of a simulation that diverges later.

    Args:
        world: hand and object (and the table), built for this protocol.
        protocol: the stability test.
        start: where hand and drives start.
        until: when to stop.
        table: what the object rests on before the lift, if the protocol has it do so.
        failure: what the trial fails by before it begins, empty if nothing.
    """
    world.reset(start.T_object_root, start.joints, start.targets)
    before = world.object_state()
    resting = None
    if table is not None and protocol.lift is not None:
        resting = weight(protocol.lift, table)
    # contacts are only known after a step
    world.step(max(1, protocol.start.settle_steps), resting)
    settled, overlap = world.object_state(), world.touch().overlap
    drift, diverged = settled.displacement_from(before), _diverged(settled)
    if diverged:
        return _trial(failure or "diverged", drift, overlap, {}, NO_LIFT, diverged)
    failure = failure or start_failure(protocol, overlap, drift)
    pushes: dict[str, Push] = {}
    lifted = NO_LIFT
    snapshot = world.save()
    if protocol.pushes is not None and (until == "end" or not failure):
        diverged = _push_all(world, protocol, protocol.pushes, settled, snapshot, until, pushes)
        failure = failure or push_failure(protocol, list(pushes.values()))
    if protocol.lift is not None and not diverged and (until == "end" or not failure):
        if protocol.pushes is not None:
            world.restore(snapshot)
        lifted, diverged = _lift(world, protocol, settled, table)
        failure = failure or ("" if diverged else lift_failure(protocol, lifted))
    return _trial(
        failure or ("diverged" if diverged else ""), drift, overlap, pushes, lifted, diverged
    )


def free_displacement(world: GraspWorld, protocol: Protocol, table: Table | None = None) -> float:
    """How far one push moves the object when no hand is near, metres; without pushes, the lift."""
    world.reset_alone()
    before, pushes = world.object_state(), protocol.pushes
    if pushes is not None:
        force = pushes.acceleration * direction_vector(pushes.directions[0])
        world.step(pushes.steps, force)
        if pushes.rest_steps:
            world.step(pushes.rest_steps)
    elif protocol.lift is not None:
        raise_hand(world, protocol.lift, protocol.timestep_ms / 1000.0, table)
    return world.object_state().displacement_from(before)


def _trial(
    failure: str,
    drift: float,
    overlap: float,
    pushes: dict[str, Push],
    lifted: Lifted,
    diverged: bool,
) -> Trial:
    each = [pushes.get(direction, NO_PUSH) for direction in DIRECTIONS]
    return Trial(
        failure,
        tuple(push.displacement for push in each),
        tuple(push.rotation for push in each),
        drift,
        tuple(push.touching for push in each),
        overlap,
        diverged,
        lifted,
    )


def _push_all(
    world: GraspWorld,
    protocol: Protocol,
    plan: Pushes,
    settled: ObjectState,
    start: Any,
    until: Until,
    pushes: dict[str, Push],
) -> bool:
    """Fills in the pushes up to ``until``; whether the simulation diverged in the one after.

    ``start`` is the world as saved when it had settled.
    """
    reference = settled
    for direction in plan.directions:
        if plan.order == "reset":
            world.restore(start)
        elif protocol.success.measured == "per-push":
            reference = world.object_state()
        world.step(plan.steps, plan.acceleration * direction_vector(direction))
        if plan.rest_steps:
            world.step(plan.rest_steps)
        state = world.object_state()
        if _diverged(state):
            return True
        pushes[direction] = Push(
            state.displacement_from(reference),
            state.rotation_from(reference),
            world.touch().touching,
        )
        if _is_over(protocol, list(pushes.values()), until):
            break
    return False


def _lift(
    world: GraspWorld, protocol: Protocol, settled: ObjectState, table: Table | None
) -> tuple[Lifted, bool]:
    """The object after the lift, and whether the simulation diverged."""
    assert protocol.lift is not None
    raise_hand(world, protocol.lift, protocol.timestep_ms / 1000.0, table)
    state = world.object_state()
    if _diverged(state):
        return NO_LIFT, True
    held = world.touch().touching and not (table is not None and world.on_table())
    lifted = Lifted(state.displacement_from(settled), state.rotation_from(settled), held)
    return lifted, False


def _is_over(protocol: Protocol, pushes: list[Push], until: Until) -> bool:
    """Whether the pushes of a trial may stop after these."""
    if until == "end":
        return False
    failure = push_failure(protocol, pushes)
    # any later push may still give a failure the name that goes before all others
    return failure == foremost_failure(protocol.success) if until == "named" else bool(failure)


def _diverged(state: ObjectState) -> bool:
    return not state.finite or float(np.linalg.norm(state.linear)) > MAX_PLAUSIBLE_SPEED
