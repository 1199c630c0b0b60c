"""A simulator on top of any ``GraspWorld``: shifted trials, early decisions, verdicts."""

from __future__ import annotations

import time
from abc import abstractmethod

import numpy as np
import torch

from gdg.data.grasps import GraspSet
from gdg.data.verdict import Verdict
from gdg.errors import GdgError
from gdg.hands.hand import Hand
from gdg.kinds.fitter import Progress
from gdg.kinds.hand_model import HandModel
from gdg.kinds.simulator import Simulator
from gdg.objects.model import ObjectModel
from gdg.penetration import penetration_depth
from gdg.protocols import Protocol
from gdg.simulation.options import SimulatorOptions
from gdg.simulation.trial import Start, Trial, Until, free_displacement, run_trial
from gdg.simulation.world import GraspWorld

#: Directions in which the hand is shifted, in this order; further shifts repeat them, doubled.
SHIFT_DIRECTIONS = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)


class WorldSimulator(Simulator):
    """A simulator that runs every trial in a ``GraspWorld``; subclasses bring the engine.

    Args:
        options: the component's options.

    Attributes:
        engine: name and version of the engine, as verdicts record them.
    """

    engine: str

    def __init__(self, options: SimulatorOptions):
        super().__init__(options)
        self._trials = options.trials

    @abstractmethod
    def build_world(self, hand: Hand, obj: ObjectModel, protocol: Protocol) -> GraspWorld:
        """A fresh world; subclasses may alter it before trials run in it."""

    def simulate(
        self,
        hand: HandModel,
        obj: ObjectModel,
        grasps: GraspSet,
        protocol: Protocol,
        progress: Progress | None = None,
    ) -> tuple[Verdict, ...]:
        """One verdict per grasp, in order.

        Raises:
            GdgError: the grasps' joints are not the hand's.
        """
        if grasps.joint_names != hand.joint_names:
            raise GdgError(
                f"The grasps have the joints {', '.join(grasps.joint_names)}, but hand "
                f"'{hand.hand.name}' has {', '.join(hand.joint_names)}."
            )
        if not len(grasps):
            return ()
        world = self.build_world(hand.hand, obj, protocol)
        free = free_displacement(world, protocol)
        depths = _start_penetration(hand, obj, grasps)
        shifts, refined = _shifts(protocol), grasps.targets is not None
        verdicts = []
        for index, start in enumerate(_starts(grasps)):
            began = time.perf_counter()
            trials: list[Trial] = []
            for shift in shifts:
                trials.append(run_trial(world, protocol, start.shifted(shift), self._until(trials)))
                if trials[-1].diverged:
                    # NaN stays in a world
                    world = self.build_world(hand.hand, obj, protocol)
                if self._trials == "decisive" and _decided(trials, len(shifts)):
                    break
            verdicts.append(
                _verdict(trials, protocol, depths[index], free, refined, self.engine, began)
            )
            if progress is not None:
                progress(index + 1, len(grasps))
        return tuple(verdicts)

    def _until(self, before: list[Trial]) -> Until:
        """How long the trial after these must run: the first that fails names the failure."""
        if not before and self._trials == "all":
            return "end"
        return "failed" if any(trial.failure for trial in before) else "named"


def _starts(grasps: GraspSet) -> list[Start]:
    poses = grasps.poses.detach().cpu().double().numpy()
    joints = grasps.joints.detach().cpu().double().numpy()
    targets = joints
    if grasps.targets is not None:
        targets = grasps.targets.detach().cpu().double().numpy()
    return [Start(*row) for row in zip(poses, joints, targets, strict=True)]


def _shifts(protocol: Protocol) -> list[np.ndarray]:
    """No shift, then those of the protocol, metres."""
    shifts = [np.zeros(3)]
    for number in range(protocol.shifts.count):
        ring, direction = divmod(number, len(SHIFT_DIRECTIONS))
        shifts.append((ring + 1) * protocol.shifts.distance_m * SHIFT_DIRECTIONS[direction])
    return shifts


def _decided(trials: list[Trial], total: int) -> bool:
    """Whether the trials still to come, up to ``total``, can't change the majority."""
    failed = sum(1 for trial in trials if trial.failure)
    return 2 * (len(trials) - failed) > total or 2 * failed >= total


def _start_penetration(hand: HandModel, obj: ObjectModel, grasps: GraspSet) -> list[float]:
    """Penetration depth of each grasp as it starts, millimetres."""
    with torch.no_grad():
        return (1000.0 * penetration_depth(hand, obj, hand.q_of(grasps))).tolist()


def _verdict(
    trials: list[Trial],
    protocol: Protocol,
    penetration_mm: float,
    free: float,
    refined: bool,
    engine: str,
    began: float,
) -> Verdict:
    first, passed = trials[0], tuple(not trial.failure for trial in trials)
    total = 1 + protocol.shifts.count
    # of all trials, since those that were left out can't change a majority
    success = 2 * sum(passed) > total
    failures = [trial.failure for trial in trials if trial.failure]
    return Verdict(
        success=success,
        failure="" if success else failures[0],
        displacement_m=first.displacement,
        rotation_rad=first.rotation,
        drift_m=first.drift,
        contact_kept=first.contact_kept,
        penetration_start_mm=penetration_mm,
        penetration_end_mm=1000.0 * first.overlap,
        free_displacement_m=free,
        shift_successes=passed,
        protocol=protocol.label,
        engine=engine,
        refined=refined,
        seconds=time.perf_counter() - began,
        trials=total,
    )
